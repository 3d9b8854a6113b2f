"""Whether the task has changed: which of the oldest episodes no longer fit the newest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .episode import Episode
from .evidence import ConditionalTest
from .samples import collect_samples, standardized

#: Probability that a change is seen where there is none.
_LEVEL = 0.005
#: A channel whose correlation with the episode's number is greater counts the episodes.
_MOST_CORRELATED = 0.9
#: Moments of change that are tried, and the least number of episodes before one.
_NUM_MOMENTS, _LEAST_BEFORE = 9, 10


def num_outdated(
    episodes: Sequence[Episode],
    channels: Sequence[int],
    *,
    least_kept: int,
    gamma: float,
    random_state: int,
) -> int:
    """Return how many of the oldest episodes no longer fit the newest; 0 where nothing changed.

    Given the channels and the step, is the return another before some episode than from there on?
    Nine moments are tried, by the test of `ConditionalTest`, and the clearest is taken. A channel
    that counts the episodes, as a battery that drains, would explain any change and is not given.

    Parameters
    ----------
    episodes : sequence of Episode
        In the order in which they came.
    channels : sequence of int
        Those that are thought to tell something about the return.
    least_kept : int
        How many of the newest episodes are never outdated.
    gamma : float
        Discount factor of the return.
    random_state : int
        Seed.

    """
    last = len(episodes) - least_kept
    if last < _LEAST_BEFORE:
        return 0
    samples = collect_samples(episodes, gamma=gamma, standardize=True)
    moments = np.unique(np.linspace(_LEAST_BEFORE, last, _NUM_MOMENTS).astype(int))
    is_after = standardized((samples.owner[:, None] >= moments).astype(float))
    num_channels = samples.states.shape[1]
    age = standardized(samples.owner.astype(float))
    timeless = [
        c for c in channels if abs(samples.states[:, c] @ age) <= _MOST_CORRELATED * len(age)
    ]
    samples = samples.with_channels(is_after)
    test = ConditionalTest(samples, gamma, random_state, level=_LEVEL, ordered=False)
    pvalues = test([(num_channels + i,) for i in range(len(moments))], timeless)
    clearest = int(np.argmin(pvalues))
    is_change = pvalues[clearest] * len(moments) <= _LEVEL
    return int(moments[clearest]) if is_change else 0
