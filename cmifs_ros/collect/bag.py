# SPDX-License-Identifier: Apache-2.0

"""Episodes of a recorded bag."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cmifs_ros.collect.episodes.builder import EpisodeBuilder
from cmifs_ros.collect.episodes.drops import explained
from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.episodes.reward_reader import RewardReader
from cmifs_ros.collect.robot_file import RobotFile
from cmifs_ros.collect.sampling.bag_reader import (
    BagError,
    Undecoded,
    messages_of,
    open_bag,
    unwatched,
)
from cmifs_ros.collect.sampling.event_order import SECOND
from cmifs_ros.collect.sampling.message_reader import event_time
from cmifs_ros.collect.sampling.sampler import Sampler
from cmifs_ros.collect.sampling.step import Step
from cmifs_ros.collect.traffic import Traffic
from cmifs_ros.core import Episode
from cmifs_ros.core.words import first

__all__ = ['BagEpisodes', 'BagError', 'episodes_of_bag', 'open_bag']

#: As the selector's parameter max_episode_steps.
MAX_EPISODE_STEPS = 1000
CLOCK = '/clock'
JOINT_STATE = 'sensor_msgs/msg/JointState'


@dataclass(frozen=True)
class BagEpisodes:
    """What a bag holds of episodes.

    Attributes
    ----------
    channel_names : tuple of str
    episodes : list of Episode
    stamps : list of numpy.ndarray of int, shape (T,)
        When the steps of each episode were, in nanoseconds.
    num_messages : int
        Messages read of the topics that were asked for.
    num_between : int
        Steps that belong to no episode, as what had ended the one before still held.
    num_cut : int
        Episodes closed at `MAX_EPISODE_STEPS`.
    num_open_steps : int
        Steps after the last end.
    dropped : dict of str to int
        How many messages, steps and episodes were dropped, by cause; causes first, then what
        follows from them.
    unreadable : dict of str to str
        Topics, none of them asked for, whose messages cannot be decoded, and why.
    traffic : Traffic
        Of the topics that were asked for, by their names in the robot file.
    action_names : tuple of str
        Of the values of the episodes' actions; empty without any.

    """

    channel_names: tuple[str, ...]
    episodes: list[Episode]
    stamps: list[np.ndarray]
    num_messages: int
    num_between: int
    num_cut: int
    num_open_steps: int
    dropped: dict[str, int]
    unreadable: dict[str, str]
    traffic: Traffic
    action_names: tuple[str, ...] = ()


def episodes_of_bag(
    path: str | Path,
    robot: RobotFile | None = None,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
) -> BagEpisodes:
    """Return a bag's whole episodes, and how much was dropped.

    Messages are read one after the other; only the episodes stay in memory. A message without a
    header's stamp is at the time at which it was recorded, by /clock if that was recorded too, as
    it is for a node with use_sim_time.

    Parameters
    ----------
    path : path
        A file or a folder.
    robot : RobotFile, optional
        Without one, the bag holds the topics `state`, `reward` and, if there is one, `action`, in
        one namespace or none.
    watch : callable, optional
        Is given the messages and their number and passes them on, for a display of progress.

    Raises
    ------
    BagError
        If rosbags is missing, the bag cannot be read, or it lacks a topic.

    """
    collector = _StatesAndRewards() if robot is None else _Sampled(robot)
    collector.builder.stamps = []
    with open_bag(path) as reader:
        topics = collector.topics_among(reader.topics, path)
        for topic in topics:
            if topic in reader.unreadable:
                raise BagError(f'{path}: {topic} cannot be read: {reader.unreadable[topic]}')
        clock = reader.topics.get(CLOCK)
        has_clock = clock is not None and clock.msgtype == 'rosgraph_msgs/msg/Clock'
        read = {*topics, CLOCK} if has_clock else set(topics)
        total = sum(c.msgcount for c in reader.connections if c.topic in read)
        count, now = 0, 0
        for topic, message, recorded in watch(messages_of(reader, path, read), total):
            if has_clock and topic == CLOCK and not isinstance(message, Undecoded):
                now = message.clock.sec * SECOND + message.clock.nanosec
                collector.set_clock(now)
            if topic in topics:
                count += 1
                if isinstance(message, Undecoded):
                    collector.note_wrong(topic, message.cause)
                else:
                    collector.add(topic, message, now if has_clock else recorded)
        traffic = Traffic(
            reader.duration / SECOND,
            {collector.name_of(topic): reader.num_messages[topic] for topic in topics},
            {collector.name_of(topic): reader.num_bytes[topic] for topic in topics},
        )
    builder, dropped = collector.builder, collector.finish()
    dropped |= {explained('episodes', cause): n for cause, n in builder.dropped.items()}
    if builder.num_partly_acting:
        dropped['actions of episodes of which some steps have none'] = builder.num_partly_acting
    return BagEpisodes(
        collector.channel_names, collector.episodes, builder.stamps, count, collector.num_between,
        builder.num_cut, builder.num_open_steps, dropped, reader.unreadable, traffic,
        collector.action_names,
    )  # fmt: skip


class _Sampled:
    """Episodes from a robot's own topics."""

    def __init__(self, robot: RobotFile):
        self._robot, self._sampler = robot, Sampler(robot, max_lateness=None)
        self.builder = EpisodeBuilder(MAX_EPISODE_STEPS)
        self.channel_names, self.action_names = robot.channel_names, robot.action_names
        self._names: dict[str, str] = {}  # Of the robot file, by topic of the bag.
        self.episodes: list[Episode] = []

    @property
    def num_between(self) -> int:
        return self._sampler.num_between

    def topics_among(self, topics: Mapping, path) -> Collection[str]:
        found = {name: _topics_called(name, topics) for name in self._robot.topics}
        missing = [name for name, called in found.items() if not called]
        if missing:
            raise BagError(
                f'{path} lacks {", ".join(sorted(missing))} of the robot file; it has '
                f'{", ".join(sorted(topics))[:1000] or "no topics"}'
            )
        for name, called in found.items():
            if len(called) > 1:
                raise BagError(
                    f'{path}: {name} of the robot file may be {first(called)}; expected a whole '
                    'name, with / before it'
                )
            kinds = {connection.msgtype for connection in topics[called[0]].connections}
            if problem := self._robot.type_problem(name, kinds):
                raise BagError(f'{path}: {problem}')
        self._names = {called[0]: name for name, called in found.items()}
        return self._names

    def name_of(self, topic: str) -> str:
        return self._names[topic]

    def add(self, topic: str, message, recorded: int) -> None:
        self._collect(self._sampler.add(self._names[topic], message, recorded))

    def note_wrong(self, topic: str, what: str) -> None:
        self._sampler.note_wrong(self._names[topic], what)

    def set_clock(self, now: int) -> None:
        self._collect(self._sampler.set_clock(now))

    def _collect(self, steps: list[Step]) -> None:
        for step in steps:
            self.episodes += self.builder.add(step.state, step.sample, step.stamp, step.action)

    def finish(self) -> dict[str, int]:
        sampler = self._sampler
        self._collect(sampler.flush())
        dropped = {f'late messages of {t}': n for t, n in sampler.late.items() if n}
        dropped |= {
            f'wrong messages of {t}, such as: {sampler.last_wrong[t]}': n
            for t, n in sampler.wrong.items()
            if n
        }
        lacking = sampler.missing.in_words(sampler.missing.counts)
        dropped |= {f'steps without {what}': n for what, n in lacking.items()}
        return dropped | sampler.ends.dropped_in_words()


def _topics_called(name: str, topics: Collection[str]) -> list[str]:
    """Return the topics that a name of the robot file means: a relative one in any namespace."""
    if f'/{name.removeprefix("/")}' in topics:
        return [f'/{name.removeprefix("/")}']
    return [] if name.startswith('/') else [t for t in topics if t.endswith(f'/{name}')]


class _StatesAndRewards:
    """Episodes from the topics that the selector itself subscribes to."""

    num_between = 0

    def __init__(self):
        self._assembler, self._reader = EpisodeAssembler(MAX_EPISODE_STEPS), RewardReader()
        self.builder = self._assembler.builder
        self.episodes: list[Episode] = []

    @property
    def channel_names(self) -> tuple[str, ...]:
        return self._assembler.channel_names or ()

    @property
    def action_names(self) -> tuple[str, ...]:
        return self._assembler.actions.names

    def topics_among(self, topics: Mapping, path) -> Collection[str]:
        spaces = [t.removesuffix('/state') for t in topics if t.endswith('/state')]
        spaces = [space for space in spaces if f'{space}/reward' in topics]
        if len(spaces) != 1:
            raise BagError(
                f'{path} has {len(spaces)} pairs of topics state and reward; expected one, or a '
                f'robot file (--robot); it has {", ".join(sorted(topics))[:1000] or "no topics"}'
            )
        action = topics.get(f'{spaces[0]}/action')
        has_actions = action is not None and action.msgtype == JOINT_STATE
        self._assembler.actions.are_published = lambda: has_actions
        names = ('state', 'reward', 'action') if has_actions else ('state', 'reward')
        return tuple(f'{spaces[0]}/{name}' for name in names)

    def name_of(self, topic: str) -> str:
        return topic

    def add(self, topic: str, message, recorded: int) -> None:
        try:
            stamp = event_time(message) or recorded
            names, values = list(message.name), array('d', message.position)
            if topic.endswith('/state'):
                self.episodes += self._assembler.add_state(stamp, names, values)
            elif topic.endswith('/action'):
                self.episodes += self._assembler.actions.add_action(stamp, names, values)
            else:
                sample = self._reader.sample_of(names, values)
                self.episodes += self._assembler.add_reward(stamp, sample)
        except (AttributeError, TypeError, ValueError) as error:
            self.note_wrong(topic, str(error))

    def note_wrong(self, topic: str, what: str) -> None:
        causes = {'state': 'unusable_state', 'action': 'malformed_action'}
        cause = causes.get(topic.rpartition('/')[2], 'malformed_reward')
        self._assembler.drop_message(cause, f'{topic}: {what}')

    def set_clock(self, now: int) -> None:
        """Do nothing: an older pair tells that time was set back."""

    def finish(self) -> dict[str, int]:
        self.episodes += self._assembler.actions.stop_waiting()
        counts = self._assembler.dropped_messages
        dropped = {explained('messages', cause): n for cause, n in counts.items()}
        return dropped | self.builder.ends.dropped_in_words()
