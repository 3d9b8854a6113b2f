# SPDX-License-Identifier: Apache-2.0

"""The open episode: its complete steps, and what the others lack."""

from __future__ import annotations

import math
from array import array
from typing import NamedTuple

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.end_counts import EndCounts
from cmifs_ros.collect.robot_file.model import Source

from .episode_ends import EpisodeEnds
from .missing_values import NO_VALUE, MissingValues
from .step import SilentTail, Step


class Beginning(NamedTuple):
    """The beginning of a step: its time, and its state, None if a channel is missing."""

    time: int
    state: array | None
    lacking: tuple[Source, ...]


class OpenEpisode:
    """Make the complete steps of an episode, and count how it ended or was lost.

    Parameters
    ----------
    number : int
    is_learned : bool
        Whether it is used for learning; if not, no steps are made.
    end : EpisodeEnds
        Knows how the newest step ended it.
    ends : EndCounts
        Counts how it ended.
    missing : MissingValues
        Counts missing rewards, and names what is missing.

    Attributes
    ----------
    step : int
        Number of transitions so far, complete or not; the caller counts them.

    """

    def __init__(
        self,
        number: int,
        is_learned: bool,
        end: EpisodeEnds,
        ends: EndCounts,
        missing: MissingValues,
    ):
        self._number, self._is_learned = number, is_learned
        self._end, self._ends, self._missing = end, ends, missing
        self.step = 0
        self._lacking: set[str] = set()  # Sources that its steps lacked.
        self._num_whole = 0
        self._tail: SilentTail | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it is used for learning and every step so far is complete."""
        return self._is_learned and not self._lacking and self._tail is None

    def advance(
        self, left: Beginning, action: array, reached: Beginning, reward: float, has_ended: bool
    ) -> list[Step]:
        """Return the steps that the transition from `left` to `reached` completes."""
        if not self._is_learned:
            return []
        end, steps = self._end, []
        if left.state is None and self._tail is not None:
            self._tail.extend(reward, left.lacking)
        elif left.state is None:
            self._lacking |= {source.name for source in left.lacking}
        elif not math.isfinite(reward):
            self._missing.counts['reward', NO_VALUE] += 1
            self._lacking.add('reward')
        else:
            self._num_whole += 1
            sample = RewardSample(
                reward, end.terminated, end.truncated, self._number, self.step - 1
            )
            step = Step(left.time, left.state, sample, action)
            if reached.state is None and not has_ended:
                self._tail = SilentTail(step, reached.lacking, self._num_whole)
            else:
                steps = [step]
        if self._tail is not None:
            steps += self._follow(self._tail, reached, has_ended)
        elif has_ended and self._lacking:
            self._ends.add_lost(end.kind, f'a step lacks {self._missing.named(self._lacking)}')
        elif has_ended:
            self._ends.add(end.kind)
        return steps

    def _follow(self, tail: SilentTail, reached: Beginning, has_ended: bool) -> list[Step]:
        """Return the step that waited while a topic was silent, once its fate is known."""
        end = self._end
        if not has_ended and tail.is_sound and reached.state is None:
            return []
        names = self._missing.named(self._lacking | tail.names)
        # Windows of a fixed length end anywhere, so these are not shortened.
        if has_ended and tail.is_sound and not self._lacking and end.kind != 'steps':
            self._ends.add_shortened(end.kind, f'they lack {names}')
            return [tail.with_end(end.terminated, end.truncated)]
        if has_ended:
            self._ends.add_lost(end.kind, f'a step lacks {names}')
        self._lacking |= tail.names
        self._tail = None
        return [tail.step]
