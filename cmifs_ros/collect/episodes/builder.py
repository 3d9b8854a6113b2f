# SPDX-License-Identifier: Apache-2.0

"""Build episodes from steps; an episode that lacks a step is dropped and counted by cause."""

from __future__ import annotations

import math
from array import array
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode

from .end_counts import EndCounts


class RewardSample(NamedTuple):
    """The reward of one step, with the other fields of its message; None if not given."""

    reward: float
    terminated: bool | None = None
    truncated: bool | None = None
    episode: int | None = None
    step: int | None = None

    @property
    def marks_ends(self) -> bool:
        """Whether the publisher marks the ends of episodes."""
        return self.terminated is not None or self.truncated is not None

    @property
    def ends_episode(self) -> bool:
        """Whether this is an episode's last step."""
        return bool(self.terminated or self.truncated)

    @property
    def end(self) -> str:
        """The kind of end, terminated or truncated, of an episode that ends here."""
        return 'terminated' if self.terminated else 'truncated'


class EpisodeBuilder:
    """Build episodes from steps in order.

    An episode with a lost step is dropped and counted; building continues with the next one. Step 0
    begins an episode; if ends are not marked, it also ends the previous one.

    Parameters
    ----------
    max_episode_steps : int
        An episode is closed as truncated at this length.
    max_episode_bytes : int, optional
        An episode is closed before its arrays exceed this size; at least 1 MB.

    Attributes
    ----------
    dropped : collections.Counter
        Number of dropped episodes by cause.
    last_drops : dict of str to str
        By cause, a message about the most recent one.
    num_cut : int
        Number of episodes closed at `max_episode_steps` or `max_episode_bytes`.
    num_partly_acting : int
        Number of episodes without actions because some of their steps have none.
    ends : EndCounts
        Episodes by kind of end, and how many of each kind were lost.
    stamps : list of numpy.ndarray of int, or None
        If a list, the stamps of each episode's steps are appended to it.

    """

    def __init__(self, max_episode_steps: int, max_episode_bytes: int = 2**62):
        self.max_episode_steps = max_episode_steps
        self.max_episode_bytes = max_episode_bytes
        self.num_cut = self.num_partly_acting = 0
        self.dropped: Counter[str] = Counter()
        self.last_drops: dict[str, str] = {}
        self.ends = EndCounts()
        self.stamps: list[np.ndarray] | None = None
        self._distances: deque[int] = deque(maxlen=1000)  # Times between steps.
        self.clear()

    def clear(self) -> None:
        """Forget the open episode; keep the counts."""
        self._forget_open()
        self._previous: RewardSample | None = None
        self._skipping = False
        self._broken_by = 'joined_midway'  # Why steps are skipped.
        self._was_cut = False

    @property
    def num_open_steps(self) -> int:
        """Steps of the open episode."""
        return len(self._open_rewards)

    @property
    def step_seconds(self) -> float:
        """Median time between recent steps; NaN if no episode has two."""
        return float(np.median(self._distances)) / 1e9 if self._distances else math.nan

    def add(
        self,
        state: Sequence[float],
        sample: RewardSample,
        stamp: int,
        action: Sequence[float] = (),
    ) -> list[Episode]:
        """Add a step to the open episode or begin one with it; return completed episodes.

        Parameters
        ----------
        state : sequence of float
        sample : RewardSample
        stamp : int
            Nanoseconds.
        action : sequence of float
            Empty if there is none.

        """
        previous = self._previous
        self._previous = sample
        completed = []
        if previous is not None and sample.episode != previous.episode:
            if self._open_rewards and previous.marks_ends:
                self.break_off('lost_end', f'episode {previous.episode} ended unseen')
            elif self._open_rewards:
                completed.append(self._close())
            self._skipping = False
            self._was_cut = False
        if self._open_rewards and sample.step == 0 and not previous.marks_ends:
            completed.append(self._close())
        if self._open_rewards and not _follows(sample, previous):
            self.break_off('step_gap', f'step {sample.step} came after step {previous.step}')

        if self._open_rewards or self._may_begin(sample, previous):
            self._open_states.extend(state)
            if self._open_stamps:
                self._distances.append(stamp - self._open_stamps[-1])
            self._open_rewards.append(sample.reward)
            self._open_actions.append(array('d', action))
            self._open_stamps.append(stamp)
            self._skipping = self._was_cut = False
        elif not self._skipping:
            self.break_off(
                'joined_midway', f'an episode begins with step {sample.step}; expected 0'
            )

        if sample.ends_episode:
            if self._open_rewards:
                self.ends.add(sample.end)
                completed.append(self._close())
            else:
                self.ends.add_lost(sample.end, self._broken_by)
            self._skipping = False
        elif self._is_full(len(state) + 1 + len(action)):
            completed.append(self._close())
            self._was_cut = True
            self.num_cut += 1
        return completed

    def skip(self, sample: RewardSample) -> None:
        """Take a reward whose state is lost; its episode is lost, too."""
        self.break_off('lost_state', 'an episode has a reward without its state')
        if sample.ends_episode:
            self.ends.add_lost(sample.end, self._broken_by)
        self._skipping = not sample.ends_episode
        self._previous = sample

    def set_back(self) -> None:
        """Drop the open episode, if any, because time was set back."""
        self._was_cut = False
        if self._open_rewards:
            self.break_off('time_backwards', 'a transition is older than the one before')

    def break_off(self, cause: str, what: str) -> None:
        """Drop the open episode; skip its remaining steps."""
        if not self._skipping:
            self._broken_by = cause
            self.dropped[cause] += 1
            self.last_drops[cause] = what
        self._forget_open()
        self._skipping = True
        self._was_cut = False

    def _may_begin(self, sample: RewardSample, previous: RewardSample | None) -> bool:
        if sample.step is not None:
            return sample.step == 0 or (self._was_cut and _follows(sample, previous))
        tells_boundaries = sample.marks_ends or sample.episode is not None
        return not (self._skipping and tells_boundaries)

    def _is_full(self, num_values: int) -> bool:
        steps = len(self._open_rewards)
        is_too_large = (steps + 1) * num_values * 8 > self.max_episode_bytes
        return steps >= self.max_episode_steps or (steps > 0 and is_too_large)

    def _close(self) -> Episode:
        rewards = np.array(self._open_rewards)
        states = np.array(self._open_states).reshape(len(rewards), -1)
        sizes = set(map(len, self._open_actions))
        actions = np.array(self._open_actions) if len(sizes) == 1 else None
        self.num_partly_acting += actions is None
        episode = Episode(states, rewards, actions)
        if self.stamps is not None:
            self.stamps.append(np.array(self._open_stamps))
        self._forget_open()
        return episode

    def _forget_open(self) -> None:
        self._open_states, self._open_rewards = array('d'), array('d')
        self._open_stamps = array('q')
        self._open_actions: list[array] = []


def _follows(sample: RewardSample, previous: RewardSample) -> bool:
    if sample.step is None:
        return True  # Without step numbers, gaps are invisible.
    return previous.step is not None and sample.step == previous.step + 1
