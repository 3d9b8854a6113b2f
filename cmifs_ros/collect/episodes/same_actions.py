# SPDX-License-Identifier: Apache-2.0

"""Reconcile episodes with and without actions for a selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted

#: If at least this share of the episodes has actions, the others are left out.
_MOST = 0.5


def with_same_actions(episodes: Sequence[Episode], least: int = 2) -> tuple[list[Episode], str]:
    """Return episodes that all have actions or all have none, and a note of what was changed.

    If most have actions, those without are left out, such as one that began before the first action
    was received. Otherwise all actions are dropped.

    Parameters
    ----------
    episodes : sequence of Episode
    least : int
        Least number of episodes to keep.

    Returns
    -------
    episodes : list of Episode
    note : str
        Empty if nothing was changed.

    """
    acting = [episode for episode in episodes if episode.actions.size]
    if len(acting) in (0, len(episodes)):
        return list(episodes), ''
    having = f'{len(acting)} of {counted(len(episodes), "episode")} have an action at every step'
    if len(acting) >= max(least, _MOST * len(episodes)):
        return acting, f'{having}: the others are not used'
    return [replace(e, actions=None) for e in episodes], f'{having}: actions are not used'
