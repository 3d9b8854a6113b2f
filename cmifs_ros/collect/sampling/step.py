# SPDX-License-Identifier: Apache-2.0

"""A step, and the last step before a topic fell silent."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from typing import NamedTuple

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.robot_file.model import Source

#: An episode is kept without its last steps if it has this many times as many complete ones.
_SHARE = 2


class Step(NamedTuple):
    """One step: its stamp in nanoseconds, state, reward and action.

    State and action have the order of `RobotFile.channel_names` and `action_names`.
    """

    stamp: int
    state: array
    sample: RewardSample
    action: array


class SilentTail:
    """The last complete step of an episode, and the rewards since, while one topic is silent.

    If the episode ends meanwhile, this step becomes its last one and gets the rewards of the steps
    after it. Otherwise episodes that fail together with a sensor would be lost.

    Parameters
    ----------
    step : Step
    lacking : iterable of Source
        Sources missing from now on.
    num_whole : int
        Number of complete steps so far.

    Attributes
    ----------
    step : Step
    names : set of str
        Names of the sources that the steps since lack.

    """

    def __init__(self, step: Step, lacking: Iterable[Source], num_whole: int):
        self.step = step
        self.names: set[str] = set()
        self._topics: set[str] = set()
        self._rewards: list[float] = []
        self._max_length = num_whole // _SHARE
        self._note(lacking)

    def _note(self, lacking: Iterable[Source]) -> None:
        self.names |= {source.name for source in lacking}
        self._topics |= {source.path.topic for source in lacking}

    def extend(self, reward: float, lacking: Iterable[Source]) -> None:
        """Add an incomplete step."""
        self._note(lacking)
        self._rewards.append(reward)

    @property
    def is_sound(self) -> bool:
        """Whether only one topic is silent, for few steps, and all rewards are known."""
        return (
            len(self._topics) == 1
            and len(self._rewards) <= self._max_length
            and all(map(math.isfinite, self._rewards))
        )

    def with_end(self, terminated: bool, truncated: bool) -> Step:
        """Return the step as the last one of the episode."""
        sample = self.step.sample
        reward = sample.reward + sum(self._rewards)
        ended = sample._replace(reward=reward, terminated=terminated, truncated=truncated)
        return self.step._replace(sample=ended)
