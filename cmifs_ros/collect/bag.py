# SPDX-License-Identifier: Apache-2.0

"""Episodes of a recorded bag."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from .episodes.drops import explained
from .episodes.pairing import EpisodeAssembler
from .episodes.reward_reader import RewardReader
from .recorded_episodes import Camera, RecordedEpisodes, RecordingError
from .robot_file import RobotFile
from .robot_file.model import CHANNEL
from .robot_file.path_check import problems_of_paths
from .sampled_episodes import MAX_EPISODE_STEPS, Collector, SampledEpisodes
from .sampling.bag_frames import IMAGES, frames_of_bag
from .sampling.bag_reader import (
    BagError,
    OpenBag,
    Undecoded,
    messages_of,
    open_bag,
    unwatched,
)
from .sampling.message_reader import event_time
from .sampling.moments import SECOND
from .simulated_time import CLOCK, CLOCK_TYPE, SimulatedTime
from .traffic import Traffic

JOINT_STATE = 'sensor_msgs/msg/JointState'


def episodes_of_bag(
    path: str | Path,
    robot: RobotFile | None = None,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
    open_bag: OpenBag = open_bag,
) -> RecordedEpisodes:
    """Return the complete episodes of a bag.

    Messages are read one by one; only the episodes stay in memory. A message without a header stamp
    gets the time at which it was recorded, or the time of /clock if that was recorded, as in a node
    with use_sim_time.

    Parameters
    ----------
    path : path
        A file or a folder.
    robot : RobotFile, optional
        Without one, the bag must hold the topics `state`, `reward` and possibly `action`, all in
        one namespace or in none.
    watch : callable, optional
        Wraps the iterable of messages, given their number, to display progress.
    open_bag : callable, optional
        Opens the bag, in place of rosbags.

    Raises
    ------
    RecordingError
        If rosbags is missing, the bag cannot be read, or it lacks a topic.

    """
    collector: Collector = _StatesAndRewards() if robot is None else SampledEpisodes(robot)
    with open_bag(path) as reader:
        kinds = {
            topic: {connection.msgtype for connection in info.connections}
            for topic, info in reader.topics.items()
        }
        topics = collector.topics_among(kinds, path)
        for topic in topics:
            if topic in reader.unreadable:
                raise BagError(f'{path}: {topic} cannot be read: {reader.unreadable[topic]}')
        if robot is not None:
            types = {name: next(iter(kinds[topic])) for topic, name in topics.items()}
            if problems := problems_of_paths(robot, types, reader.types.fields_of):
                raise BagError('\n'.join([f'{path} does not fit the robot file:', *problems]))
        clock = reader.topics.get(CLOCK)
        has_clock = clock is not None and clock.msgtype == CLOCK_TYPE
        read = {*topics, CLOCK} if has_clock else set(topics)
        total = sum(c.msgcount for c in reader.connections if c.topic in read)
        count, simulated = 0, SimulatedTime()
        for topic, message, recorded in watch(messages_of(reader, path, read), total):
            if has_clock and topic == CLOCK and not isinstance(message, Undecoded):
                simulated.take(message)
                collector.set_clock(simulated.now)
            if topic in topics:
                count += 1
                if isinstance(message, Undecoded):
                    collector.note_wrong(topic, message.cause)
                else:
                    collector.add(topic, message, simulated.now if has_clock else recorded)
        traffic = Traffic(
            simulated.seconds if has_clock else reader.duration / SECOND,
            {name: reader.num_messages[topic] for topic, name in topics.items()},
            {name: reader.num_bytes[topic] for topic, name in topics.items()},
            is_simulated=has_clock,
        )
    found = collector.recorded(count, traffic, reader.unreadable)
    if robot is None:
        return found
    return replace(found, cameras=_cameras(robot, found, kinds, path, open_bag))


def _cameras(
    robot: RobotFile,
    found: RecordedEpisodes,
    kinds: Mapping[str, Collection[str]],
    path: str | Path,
    open_bag: OpenBag,
) -> dict[str, Camera]:
    """Return the cameras, by sensor: channels that are whole messages with a picture."""
    cameras: dict[str, Camera] = {}
    for source in robot.sources:
        topic = found.topics[source.path.topic]
        is_whole = source.encoder is not None and not source.path.fields
        if source.role == CHANNEL and is_whole and set(IMAGES).intersection(kinds[topic]):
            cameras[source.name] = partial(frames_of_bag, path, open_bag, topic, found.stamps)
    return cameras


class _StatesAndRewards(Collector):
    """Read episodes from the topics that the selector itself subscribes to."""

    def __init__(self):
        self._assembler, self._reader = EpisodeAssembler(MAX_EPISODE_STEPS), RewardReader()
        super().__init__(self._assembler.builder)

    @property
    def channel_names(self) -> tuple[str, ...]:
        return self._assembler.channel_names or ()

    @property
    def action_names(self) -> tuple[str, ...]:
        return self._assembler.actions.names

    def topics_among(self, topics: Mapping[str, Collection[str]], path) -> dict[str, str]:
        spaces = [t.removesuffix('/state') for t in topics if t.endswith('/state')]
        spaces = [space for space in spaces if f'{space}/reward' in topics]
        if not spaces:
            raise RecordingError(
                f'a robot file is missing (--robot FILE): {path} has no topics state and reward; '
                f'it has {", ".join(sorted(topics))[:1000] or "no topics"}'
            )
        if len(spaces) != 1:
            raise RecordingError(
                f'{path} has {len(spaces)} pairs of topics state and reward; expected one, or a '
                f'robot file (--robot); it has {", ".join(sorted(topics))[:1000] or "no topics"}'
            )
        has_actions = JOINT_STATE in topics.get(f'{spaces[0]}/action', ())
        self._assembler.actions.are_published = lambda: has_actions
        names = ('state', 'reward', 'action') if has_actions else ('state', 'reward')
        return {f'{spaces[0]}/{name}': f'{spaces[0]}/{name}' for name in names}

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
        """Do nothing: here an older pair shows that time was set back."""

    def finish(self) -> dict[str, int]:
        self.episodes += self._assembler.actions.stop_waiting()
        counts = self._assembler.dropped_messages
        return {explained('messages', cause): n for cause, n in counts.items()}
