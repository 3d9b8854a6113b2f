# SPDX-License-Identifier: Apache-2.0

"""What the selector says of its selection on /diagnostics."""

from __future__ import annotations

import json
from math import inf

from diagnostic_msgs.msg import DiagnosticStatus

from cmifs_ros.collect.selection_report import headline
from cmifs_ros.core.words import listed

from . import diagnostics
from .selection_in_use import SelectionInUse
from .selection_queue import SelectionQueue
from .state_relay import StateRelay


def selection(
    name: str,
    in_use: SelectionInUse | None,
    *,
    relay: StateRelay,
    queue: SelectionQueue,
    attempt: tuple[bytes, str],
    settings: dict,
) -> DiagnosticStatus:
    """Return the status of the selection.

    Parameters
    ----------
    name : str
        Of the status.
    in_use : SelectionInUse or None
    relay : StateRelay
        What applies it.
    queue : SelectionQueue
    attempt : tuple of bytes and str
        Level and message of the last attempt if it failed or confirmed nothing, or empty; what is
        waited for if there is no selection.
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
    return diagnostics.status(name, level, message, values)
