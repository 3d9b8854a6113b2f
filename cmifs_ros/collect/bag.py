"""A recorded bag's messages, read, not played: MCAP and db3, and ROS 1.

rosbags is optional: `pip install 'rosbags>=0.11,<0.12'`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cmifs_ros.core import Episode

from .robot_file import RobotFile
from .sampler import Sampler, event_time
from .transitions import EpisodeAssembler


class BagError(Exception):
    """A bag cannot be used; the message says why."""


def episodes_of_bag(
    path: str | Path,
    robot: RobotFile,
    max_episode_steps: int = 10_000,
    on_message: Callable[[], None] = lambda: None,
) -> tuple[list[Episode], Sampler, EpisodeAssembler]:
    """Return a bag's whole episodes, and the sampler and assembler, which count what was dropped.

    Messages are read one after the other; only the episodes stay in memory. A message without a
    header's stamp is at the time at which it was recorded.

    Parameters
    ----------
    path : path
        A file or a folder.
    robot : RobotFile
    max_episode_steps : int, optional
        A longer episode is cut.
    on_message : callable, optional
        Called after each message, for a display of progress.

    Raises
    ------
    BagError
        If rosbags is missing, the bag cannot be read, or it lacks a topic of the robot file.

    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError(
            "bags are read by rosbags; install it: pip install 'rosbags>=0.11,<0.12'"
        ) from None
    sampler = Sampler(robot)
    assembler = EpisodeAssembler(max_episode_steps)
    episodes: list[Episode] = []
    names = list(robot.channel_names)

    def collect(steps) -> None:
        for step in steps:
            episodes.extend(assembler.add_state(step.stamp, names, step.state))
            episodes.extend(assembler.add_reward(step.stamp, step.sample))

    try:
        store = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([Path(path)], default_typestore=store) as reader:
            wanted = [c for c in reader.connections if c.topic in robot.topics]
            missing = set(robot.topics) - {c.topic for c in wanted}
            if missing:
                raise BagError(
                    f'{path} lacks {", ".join(sorted(missing))} of the robot file; it has '
                    f'{", ".join(sorted(reader.topics))[:1000]}'
                )
            for connection, recorded, data in reader.messages(wanted):
                message = reader.deserialize(data, connection.msgtype)
                collect(sampler.add(connection.topic, message, event_time(message, recorded)))
                on_message()
    except BagError:
        raise
    except (AnyReaderError, OSError) as error:
        raise BagError(f'{path} cannot be read as a bag: {error}') from None
    except Exception as error:  # A torn file breaks its readers in many ways.
        raise BagError(f'{path} breaks off: {type(error).__name__}: {error}') from error
    collect(sampler.flush())
    return episodes, sampler, assembler
