# SPDX-License-Identifier: Apache-2.0

"""Detect concept drift: how many of the oldest episodes no longer fit the newest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .samples import scaled, standardized
from .targets import ACTION, RETURN, TargetTest
from .thinning import ThinnedEpisodes

#: Probability of detecting a change although there is none.
_LEVEL = 0.005
#: A channel that correlates more strongly with the episode number acts as an episode counter.
_MOST_CORRELATED = 0.9
#: Number of change points tried, and the least number of episodes before a change point.
_NUM_CHANGE_POINTS, _LEAST_BEFORE = 9, 10


def num_outdated(
    episodes: ThinnedEpisodes,
    channels: Sequence[int],
    *,
    least_kept: int,
    gamma: float,
    random_state: int,
    target: str = RETURN,
) -> int:
    """Return how many of the oldest episodes no longer fit the newest; 0 if nothing changed.

    `TargetTest` tests whether the return, given the channels, the action and the step, differs
    between the episodes before and after a change point; with the target 'action', whether the
    action does. Nine change points are tried, and the one with the least p-value counts. A channel
    that acts as an episode counter, such as a draining battery, would explain any change, so it is
    left out.

    Parameters
    ----------
    episodes : ThinnedEpisodes
        In the order in which they were recorded.
    channels : sequence of int
        The channels of the sensors that may be informative.
    least_kept : int
        Number of newest episodes that are never outdated.
    gamma : float
        Discount factor of the return.
    random_state : int
        Seed.
    target : str
        One of `TARGETS`; for a decision, the return is tested.

    Returns
    -------
    int

    """
    last = len(episodes) - least_kept
    if last < _LEAST_BEFORE:
        return 0
    samples = scaled(episodes.samples)
    change_points = np.unique(np.linspace(_LEAST_BEFORE, last, _NUM_CHANGE_POINTS).astype(int))
    is_after = standardized((samples.owner[:, None] >= change_points).astype(float))
    num_channels = samples.states.shape[1]
    age = standardized(samples.owner.astype(float))
    timeless = [
        c for c in channels if abs(samples.states[:, c] @ age) <= _MOST_CORRELATED * len(age)
    ]
    samples = samples.with_channels(is_after)
    test = TargetTest(
        samples,
        ACTION if target == ACTION else RETURN,
        (),
        [f'action{i}' for i in range(samples.actions.shape[1])],
        gamma,
        random_state=random_state,
        ordered=False,
    )
    pvalues = test([(num_channels + i,) for i in range(len(change_points))], timeless)
    clearest = int(np.argmin(pvalues))
    is_change = pvalues[clearest] * len(change_points) <= _LEVEL
    return int(change_points[clearest]) if is_change else 0
