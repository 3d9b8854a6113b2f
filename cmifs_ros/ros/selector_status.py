"""What the selector says of its selection on /diagnostics."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import inf

from diagnostic_msgs.msg import DiagnosticStatus

from cmifs_ros.collect.episodes.filter import StateFilter
from cmifs_ros.collect.selection_report import headline
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted, listed

from . import diagnostics
from .selection_queue import SelectionQueue


def selection(
    name: str,
    found: Selection | None,
    *,
    queue: SelectionQueue,
    state_filter: StateFilter | None,
    changed: Sequence[str],
    age: float,
    cause: str,
    so_far: tuple[bytes, str],
    error: str,
    episodes: int,
    settings: dict,
) -> DiagnosticStatus:
    """Return the status of the selection.

    Parameters
    ----------
    name : str
        Of the status.
    found : Selection or None
        The one in use, which `state_filter` applies.
    queue : SelectionQueue
    state_filter : StateFilter or None
    changed : sequence of str
        What no longer looks as it did when it was made.
    age : float
        In seconds.
    cause : str
        Why it was made.
    so_far : tuple of bytes and str
        Level and message of what the last attempt found if it confirmed nothing, or empty.
    error : str
        Why the last attempt failed, or empty.
    episodes : int
        Episodes that there are.
    settings : dict
        The node's parameters.

    """
    values = {
        'worker': 'computing' if queue.busy else 'idle',
        'worker pid': queue.worker_pid or 'none',
        'computing for s': f'{queue.running_for:.1f}',
        'progress': f'{queue.progress:.0%}',
        'parameters': json.dumps({k: str(v) if v == inf else v for k, v in settings.items()}),
    }
    if found is not None:
        values |= {
            'number': found.number,
            'names': listed(found.names),
            'indices': listed([str(index) for index in found.indices]),
            'age in s': f'{age:.0f}',
            'cause': cause,
            'episodes used': found.episodes,
            'seconds taken': f'{found.seconds:.2f}',
            'states without a selected channel': state_filter.num_lacking,
        }
    if error:
        level, message = diagnostics.ERROR, error
    elif found is None and so_far[1]:
        level, message = so_far
    elif found is None:
        level = diagnostics.OK
        message = (
            f'no selection yet; {counted(episodes, "episode")} of at least '
            f'{settings["min_episodes"]}'
        )
    elif state_filter.is_lacking:
        level, message = diagnostics.WARN, 'the newest state lacks a selected channel'
    elif changed:
        level = diagnostics.WARN
        message = f'the data have changed since the selection: {listed(changed)}'
    elif so_far[1]:
        level, message = so_far[0], f'{headline(found)}; since then: {so_far[1]}'
    else:
        level, message = diagnostics.OK, headline(found)
    return diagnostics.status(name, level, message, values)
