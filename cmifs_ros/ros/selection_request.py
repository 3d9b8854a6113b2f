# SPDX-License-Identifier: Apache-2.0

"""Turn a request for a selection into a job for the worker, or refuse it."""

from __future__ import annotations

from typing import Any

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.episodes.reward_check import problem_of_target
from cmifs_ros.collect.episodes.same_actions import with_same_actions
from cmifs_ros.core.looks import level_of_look
from cmifs_ros.core.words import counted

from .selection_in_use import SelectionInUse
from .selection_queue import Job, RefusedError
from .selector_input import SelectorInput
from .selector_parameters import check_parameters, selector_settings


class UnusableDataError(RefusedError):
    """There are enough episodes, but they cannot answer the question; the message says why."""


def make_job(
    revision: int,
    cause: str,
    *,
    buffer: EpisodeBuffer,
    source: SelectorInput,
    settings: dict,
    in_use: SelectionInUse | None,
    losses: str,
) -> Job:
    """Return a job for a selection from the episodes held.

    Parameters
    ----------
    revision, cause
        As of `Job`.
    buffer : EpisodeBuffer
    source : SelectorInput
        Where the episodes come from.
    settings : dict
        The node's parameters.
    in_use : SelectionInUse or None
        Its confirmed sensors stay unless they are dispensable now.
    losses : str
        As of `Selection`.

    Raises
    ------
    UnusableDataError
        If no selection can be made from these episodes.
    RefusedError
        If there are too few episodes, or a parameter does not fit them.

    """
    needed, names = settings['min_episodes'], source.channel_names
    if len(buffer) < needed:
        raise RefusedError(
            f'{counted(len(buffer), "episode")} so far; a selection needs at least '
            f'{needed} (min_episodes)' + (f'; {source.problem}' if source.problem else '')
        )
    try:
        check_parameters(settings, names)
        of_selector = selector_settings(settings, names, source.gamma(), source.target)
    except ValueError as error:
        raise RefusedError(str(error)) from None
    if 'significance' in of_selector:
        of_selector['significance'] = level_of_look(
            settings['significance'], buffer.renewals, num_first=needed
        )
    held = buffer.snapshot()
    episodes, note = with_same_actions(held, needed)
    problem = problem_of_target(episodes, source.target) if settings['method'] != 'kdr' else ''
    if problem:
        raise UnusableDataError(f'{problem} ({note})' if note else problem)
    options: dict[str, Any] = {
        'start': () if in_use is None else in_use.confirmed,
        'least_kept': needed if settings['forget_outdated'] else None,
        'losses': losses,
        'action_names': source.action_names if episodes[0].actions.size else (),
    }
    return Job(
        revision,
        buffer.num_clears,
        cause,
        (episodes, names, settings['method'], of_selector, options),
        # Episodes without their actions are copies of those held.
        held if len(held) == len(episodes) else episodes,
        note,
    )
