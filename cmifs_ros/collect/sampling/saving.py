# SPDX-License-Identifier: Apache-2.0

"""Which topics are switched off while a selection is stable, and when they come back."""

from __future__ import annotations

import math
from collections import deque

from cmifs_ros.collect.advice import advice_of
from cmifs_ros.collect.robot_file.model import RobotFile
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted, listed


class Saving:
    """Switch topics off at the end of an episode, and on again at any time.

    A topic can go if all its channels are dispensable in each of the last `after` selections, which
    must have selected the same sensors. Topics needed for actions, steps, the reward or ends of
    episodes stay, and so do latched ones: they publish rarely, and their last message would be
    lost.

    Parameters
    ----------
    robot : RobotFile
        Without `saving` nothing is ever switched off.

    Attributes
    ----------
    off : frozenset of str
        The topics that are switched off.

    """

    def __init__(self, robot: RobotFile):
        self._cycle = robot.saving
        self._topics = robot.channel_topics
        latched = {s.path.topic for s in robot.sources if s.max_age == math.inf}
        self._needed = latched.union(robot.topics_for(()))
        self._number: int | None = None  # of the newest selection
        self._selected: frozenset[str] = frozenset()
        #: Topics that can go, by selection since the selected channels changed.
        self._can_go: deque[frozenset[str]] = deque(maxlen=self._cycle.after if self._cycle else 1)
        self._cause = ''  # Why all topics are on, or no earlier selection counts.
        self._num_episodes = 0  # complete ones while all topics are on; all while some are off
        self.off: frozenset[str] = frozenset()

    def select(self, selection: Selection) -> None:
        """Note a selection in use, which may be published again with a doubt."""
        if self._cycle is None:
            return
        is_new = selection.number != self._number
        cause = selection.doubt
        if self._number is not None and set(selection.names) != self._selected:
            cause = cause or 'the selection has changed'
        elif is_new and selection.outdated:
            cause = cause or 'the task has changed'
        if cause:
            self._begin_anew(cause)
        if is_new and not selection.doubt:
            found = {item.name for item in advice_of(selection, self._topics).can_go}
            self._can_go.append(frozenset(found - self._needed))
        self._number, self._selected = selection.number, frozenset(selection.names)
        if not self.off <= self._agreed():
            self._switch_on(cause or 'fewer topics can go')

    def explore(self, cause: str) -> None:
        """Switch all topics on until enough further selections agree."""
        self._begin_anew(cause)
        self._switch_on(cause)

    def _begin_anew(self, cause: str) -> None:
        self._can_go.clear()
        self._cause = cause

    def _switch_on(self, cause: str) -> None:
        """Switch all topics on for as many complete episodes as the robot file says."""
        self.off, self._num_episodes, self._cause = frozenset(), 0, cause

    def end_episode(self, is_whole: bool) -> None:
        """Note the end of an episode; it is whole if it has every channel at every step."""
        if self._cycle is None:
            return
        self._num_episodes += is_whole or bool(self.off)
        if self.off:
            if self._num_episodes >= self._cycle.explore_every:
                self._switch_on(f'after {counted(self._num_episodes, "episode")} without them')
        elif self._num_episodes >= self._cycle.explore_episodes and self._agreed():
            self.off, self._num_episodes = self._agreed(), 0

    def _agreed(self) -> frozenset[str]:
        """Return the topics that can go according to enough selections."""
        if len(self._can_go) < self._cycle.after:
            return frozenset()
        return frozenset.intersection(*self._can_go)

    def in_words(self) -> str:
        """Return the state of the cycle as text."""
        cycle, count = self._cycle, self._num_episodes
        if self.off:
            left = counted(cycle.explore_every - count, 'episode')
            return f'switched off: {listed(sorted(self.off))}; on again after {left}'
        why = f' ({self._cause})' if self._cause else ''
        if len(self._can_go) < cycle.after:
            stood = f'{len(self._can_go)} of {cycle.after}'
            return f'all topics are on{why}: same selection {stood} times'
        if not (agreed := self._agreed()):
            return f'all topics are on{why}: none can go'
        if count >= cycle.explore_episodes:
            return f'all topics are on{why}; off after this episode: {listed(sorted(agreed))}'
        whole = f'{count} of {counted(cycle.explore_episodes, "complete episode")}'
        return f'all topics are on{why}: {whole}'
