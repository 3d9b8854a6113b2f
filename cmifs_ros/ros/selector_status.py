# SPDX-License-Identifier: Apache-2.0

"""The selector's diagnostics: the selection in use and the last attempt."""

from __future__ import annotations

import json
from math import inf

from diagnostic_msgs.msg import DiagnosticStatus

from cmifs_ros.collect.selection_report import headline
from cmifs_ros.core.words import counted, listed

from . import diagnostics
from .selection_queue import SelectionQueue
from .selector_output import SelectorOutput


def selection(
    name: str,
    output: SelectorOutput,
    *,
    queue: SelectionQueue,
    attempt: tuple[bytes, str],
    num_episodes: int,
    settings: dict,
) -> DiagnosticStatus:
    """Return the status of the selection.

    Parameters
    ----------
    name : str
        Name of the status.
    output : SelectorOutput
    queue : SelectionQueue
    attempt : tuple of bytes and str
        Level and message of the last attempt if it failed or confirmed nothing, else empty.
    num_episodes : int
        Episodes held.
    settings : dict
        The node's parameters.

    """
    in_use, relay = output.in_use, output.relay
    values = {
        'worker': 'computing' if queue.busy else 'idle',
        'worker pid': queue.worker_pid or 'none',
        'computing for s': f'{queue.running_for:.1f}',
        'progress': f'{queue.progress:.0%}',
        'parameters': json.dumps({k: str(v) if v == inf else v for k, v in settings.items()}),
    }
    if in_use is not None:
        found = in_use.selection
        values |= {
            'number': found.number,
            'names': listed(found.names),
            'indices': listed([str(index) for index in found.indices]),
            'age in s': f'{in_use.age:.0f}',
            'cause': in_use.cause,
            'episodes used': found.episodes,
            'seconds taken': f'{found.seconds:.2f}',
            'states without a selected channel': relay.num_lacking,
        }
    if sampler := relay.other_publisher():
        values['selected_state comes from'] = sampler
    level, message = attempt
    if in_use is None and not message:
        message = _waiting_for(num_episodes, settings)
    if level != diagnostics.ERROR and in_use is not None:
        doubt = in_use.doubt('')
        if relay.is_lacking:
            level, message = diagnostics.WARN, 'the newest state lacks a selected channel'
        elif doubt:
            level, message = diagnostics.WARN, doubt
        elif message:
            message = f'{headline(in_use.selection)}; since then: {message}'
        else:
            message = headline(in_use.selection)
    if output.conflict:
        level = max(level, diagnostics.WARN)
        message = f'{output.conflict}; {message}'
    return diagnostics.status(name, level, message, values)


def _waiting_for(num_episodes: int, settings: dict) -> str:
    episodes, needed = counted(num_episodes, 'episode'), settings['min_episodes']
    if num_episodes < needed:
        return f'no selection yet: {episodes} of at least {needed}'
    if not settings['selection_period']:
        return f'no selection yet: call select_features ({episodes}; selection_period is 0)'
    return f'no selection yet: the next one will use {episodes}'
