# SPDX-License-Identifier: Apache-2.0

"""A step, and the last one before a topic fell silent."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from typing import NamedTuple

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.robot_file.model import Source

#: An episode is kept without its last steps if it has so many times as many before them.
_SHARE = 2


class Step(NamedTuple):
    """One step: nanoseconds, what there was, what was paid for it and what the robot did.

    State and action are in the order of `RobotFile.channel_names` and `action_names`.
    """

    stamp: int
    state: array
    sample: RewardSample
    action: array


class SilentTail:
    """An episode's last whole step, and the rewards since, while one topic is silent.

    If the episode ends so, this step becomes its last, and is paid what the steps after it were:
    an episode that fails just where a sensor fails too would be lost otherwise.

    Parameters
    ----------
    step : Step
    lacking : iterable of Source
        What is missing from now on.
    num_whole : int
        Steps of the episode so far.

    Attributes
    ----------
    step : Step
    names : set of str
        What the steps since lack.

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
        """Add a step that lacks something."""
        self._note(lacking)
        self._rewards.append(reward)

    @property
    def is_sound(self) -> bool:
        """Whether one topic alone is silent, for a few steps, of which all rewards are known."""
        return (
            len(self._topics) == 1
            and len(self._rewards) <= self._max_length
            and all(map(math.isfinite, self._rewards))
        )

    def with_end(self, terminated: bool, truncated: bool) -> Step:
        """Return the step as the episode's last."""
        sample = self.step.sample
        reward = sample.reward + sum(self._rewards)
        ended = sample._replace(reward=reward, terminated=terminated, truncated=truncated)
        return self.step._replace(sample=ended)
