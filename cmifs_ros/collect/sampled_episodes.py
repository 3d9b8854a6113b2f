# SPDX-License-Identifier: Apache-2.0

"""From recorded messages to episodes, by a robot file or by the pairing of the selector."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Mapping

from cmifs_ros.core import Episode
from cmifs_ros.core.words import did_you_mean, first

from .episodes.builder import EpisodeBuilder
from .episodes.drops import explained
from .episodes.end_counts import EndCounts
from .episodes.episode_check import Condition
from .recorded_episodes import RecordedEpisodes, RecordingError
from .robot_file import RobotFile
from .sampling.missing_values import NOT_YET
from .sampling.sampler import Sampler
from .sampling.step import Step
from .traffic import Traffic

#: Like the selector's parameter max_episode_steps.
MAX_EPISODE_STEPS = 1000

#: Causes by which the builder drops an episode because the sampler lacks a step.
_LACKING = ('step_gap', 'joined_midway', 'lost_end')


class Collector(ABC):
    """Make episodes from messages.

    Attributes
    ----------
    builder : EpisodeBuilder
    episodes : list of Episode
        The complete ones so far.

    """

    def __init__(self, builder: EpisodeBuilder):
        self.builder = builder
        self.builder.stamps = []
        self.episodes: list[Episode] = []

    @property
    def num_between(self) -> int:
        """Steps that belong to no episode."""
        return 0

    @property
    def ends(self) -> Mapping[Condition, Counter[bool | None]]:
        """How often the conditions that end episodes were true, false and unknown."""
        return {}

    @property
    def topics(self) -> Mapping[str, str]:
        """The recorded topics by their names in the robot file."""
        return {}

    @property
    def end_counts(self) -> EndCounts:
        """Episodes by kind of end, and how many of each kind were lost."""
        return self.builder.ends

    @property
    def broken(self) -> Mapping[str, int]:
        """Number of dropped episodes by cause, without those that `finish` explains."""
        return self.builder.dropped

    @property
    @abstractmethod
    def channel_names(self) -> tuple[str, ...]:
        """The channels of a state, in order."""

    @property
    @abstractmethod
    def action_names(self) -> tuple[str, ...]:
        """The values of an action, in order."""

    @abstractmethod
    def topics_among(self, topics: Mapping[str, Collection[str]], path) -> dict[str, str]:
        """Return the topics to read: names in the robot file by names in the recording.

        Parameters
        ----------
        topics : mapping of str to collection of str
            Existing topics with their types; without types if these are unknown.
        path : object
            The recording, for messages.

        Raises
        ------
        RecordingError
            If a topic is missing or has another type than in the robot file.

        """

    @abstractmethod
    def add(self, topic: str, message, recorded: int) -> None:
        """Add a message with its recording time in nanoseconds."""

    @abstractmethod
    def note_wrong(self, topic: str, what: str) -> None:
        """Count an unusable message."""

    @abstractmethod
    def set_clock(self, now: int) -> None:
        """Set the time of /clock in nanoseconds."""

    @abstractmethod
    def finish(self) -> dict[str, int]:
        """Process all waiting messages; return what was dropped, by cause."""

    def recorded(
        self, num_read: int, traffic: Traffic, unreadable: Mapping[str, str]
    ) -> RecordedEpisodes:
        """Return the collected episodes, when all messages were added."""
        dropped, builder = self.finish(), self.builder
        dropped |= self.end_counts.dropped_in_words()
        dropped |= {explained('episodes', cause): n for cause, n in self.broken.items() if n}
        if builder.num_partly_acting:
            cause = 'actions of episodes in which some steps have none'
            dropped[cause] = builder.num_partly_acting
        return RecordedEpisodes(
            self.channel_names, self.episodes, num_read, self.action_names, builder.stamps,
            num_between=self.num_between, num_cut=builder.num_cut,
            num_open_steps=builder.num_open_steps, dropped=dropped, unreadable=unreadable,
            traffic=traffic, ends=self.ends, end_counts=self.end_counts, topics=self.topics,
        )  # fmt: skip


class SampledEpisodes(Collector):
    """Make episodes from a robot's own topics by its robot file."""

    def __init__(self, robot: RobotFile):
        super().__init__(EpisodeBuilder(MAX_EPISODE_STEPS))
        self._robot, self._sampler = robot, Sampler(robot, max_lateness=None)
        self._names: dict[str, str] = {}

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The channels of a state, in order."""
        return self._robot.channel_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """The values of an action, in order."""
        return self._robot.action_names

    @property
    def num_between(self) -> int:
        """Steps that belong to no episode."""
        return self._sampler.num_between

    @property
    def ends(self) -> Mapping[Condition, Counter[bool | None]]:
        """How often the conditions that end episodes were true, false and unknown."""
        return self._sampler.end_looks

    @property
    def topics(self) -> Mapping[str, str]:
        """The recorded topics by their names in the robot file."""
        return {name: topic for topic, name in self._names.items()}

    @property
    def end_counts(self) -> EndCounts:
        """Episodes by kind of end, and how many of each kind were lost."""
        return self._sampler.ends

    @property
    def broken(self) -> Mapping[str, int]:
        """Number of dropped episodes by cause, without those that the sampler explains."""
        left = self._sampler.ends.total_lost
        broken = dict(self.builder.dropped)
        for cause in _LACKING:
            named = min(left, broken.get(cause, 0))
            if named:
                broken[cause] -= named
                left -= named
        return broken

    def topics_among(self, topics: Mapping[str, Collection[str]], path) -> dict[str, str]:
        """Return the topics to read; see `Collector`."""
        found = {name: _topics_called(name, topics) for name in self._robot.topics}
        missing = [name for name, called in found.items() if not called]
        if missing:
            raise RecordingError(
                f'{path} lacks {", ".join(sorted(missing))} of the robot file'
                f'{did_you_mean(sorted(missing)[0], list(topics))}; it has '
                f'{", ".join(sorted(topics))[:1000] or "no topics"}'
            )
        for name, called in found.items():
            if len(called) > 1:
                raise RecordingError(
                    f'{path}: {name} of the robot file may be {first(called)}; expected a full '
                    'name that begins with /'
                )
            kinds = topics[called[0]]
            if kinds and (problem := self._robot.type_problem(name, kinds)):
                raise RecordingError(f'{path}: {problem}')
        for name, called in found.items():
            if self._names.setdefault(called[0], name) != name:
                raise RecordingError(
                    f'{path}: {self._names[called[0]]} and {name} of the robot file are both '
                    f'{called[0]}; expected one name for it, such as {called[0]}'
                )
        return self._names

    def add(self, topic: str, message, recorded: int) -> None:
        """Add a message."""
        self._collect(self._sampler.add(self._names[topic], message, recorded))

    def note_wrong(self, topic: str, what: str) -> None:
        """Count an unusable message."""
        self._sampler.note_wrong(self._names[topic], what)

    def set_clock(self, now: int) -> None:
        """Set the time of /clock."""
        self._collect(self._sampler.set_clock(now))

    def _collect(self, steps: list[Step]) -> None:
        for step in steps:
            self.episodes += self.builder.add(step.state, step.sample, step.stamp, step.action)

    def finish(self) -> dict[str, int]:
        """Process all waiting messages; return what was dropped."""
        sampler = self._sampler
        self._collect(sampler.flush())
        dropped = {f'late messages of {t}': n for t, n in sampler.late.items() if n}
        dropped |= {
            f'wrong messages of {t}, such as: {sampler.last_wrong[t]}'
            + (' (all are wrong)' if n == sampler.received[t] else ''): n
            for t, n in sampler.wrong.items()
            if n
        }
        dropped |= {
            f'steps back of {t} that may be resets of time: record /clock to tell': n
            for t, n in sampler.unclear.items()
        }
        lacking = sampler.missing.in_words(sampler.missing.counts)
        dropped |= {
            f'steps without {what}': n for what, n in lacking.items() if not what.endswith(NOT_YET)
        }
        num_before, last = sampler.missing.before_first()
        if num_before:
            dropped[f'steps at the beginning, before the first message of {last}'] = num_before
        return dropped


def _topics_called(name: str, topics: Collection[str]) -> list[str]:
    """Return the topics that match a name of the robot file, if relative in any namespace."""
    if f'/{name.removeprefix("/")}' in topics:
        return [f'/{name.removeprefix("/")}']
    return [] if name.startswith('/') else [t for t in topics if t.endswith(f'/{name}')]
