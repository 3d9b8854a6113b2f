# SPDX-License-Identifier: Apache-2.0

"""Reconcile episodes with and without actions for a selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted

#: If at least this share of the episodes has actions, the others are left out.
_MOST = 0.5


def which_alike(acting: Sequence[bool], least: int = 2) -> tuple[list[bool], bool, str]:
    """Return which episodes to use, whether with actions, and a note of what is changed.

    If most have actions, those without are left out, such as one that began before the first action
    was received. Otherwise all actions are dropped.

    Parameters
    ----------
    acting : sequence of bool
        Whether each episode has actions.
    least : int
        Least number of episodes to keep.

    Returns
    -------
    which : list of bool
    with_actions : bool
    note : str
        Empty if nothing is changed.

    """
    count = sum(acting)
    if count in (0, len(acting)):
        return [True] * len(acting), count > 0, ''
    having = f'{count} of {counted(len(acting), "episode")} have an action at every step'
    if count >= max(least, _MOST * len(acting)):
        return list(acting), True, f'{having}: the others are not used'
    return [True] * len(acting), False, f'{having}: actions are not used'


def with_same_actions(episodes: Sequence[Episode], least: int = 2) -> tuple[list[Episode], str]:
    """Return the episodes to use, all with or all without actions, and the note; `which_alike`."""
    which, with_actions, note = which_alike([e.actions.size > 0 for e in episodes], least)
    used = list(compress(episodes, which))
    if note and not with_actions:
        used = [replace(episode, actions=None) for episode in used]
    return used, note
