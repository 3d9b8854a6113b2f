# SPDX-License-Identifier: Apache-2.0

"""Read episodes from any recording: a bag, tables, HDF5, or data frames in memory."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from operator import itemgetter
from pathlib import Path

from .bag import episodes_of_bag
from .observed_bag import robot_file_of_bag
from .recorded_episodes import RecordedEpisodes, RecordingError
from .robot_file import RobotFile
from .robot_file.template import robot_file_of_topics
from .sampled_episodes import SampledEpisodes
from .sampling.bag_reader import OpenBag, open_bag, unwatched
from .sampling.moments import SECOND
from .tables import arrow, hdf5, lerobot, lerobot_info, ulog
from .tables.observed import observed
from .tables.roles import Roles, steps_by_roles
from .tables.table import Table
from .traffic import Traffic

#: The files of bags, and what makes a folder of them one bag.
_BAGS, _METADATA = ('.mcap', '.db3', '.bag'), 'metadata.yaml'
_EXPECTED = (
    'expected a bag (a folder with its metadata.yaml, .mcap, .db3 or .bag), .parquet, .csv, .h5, '
    ".hdf5, LeRobot's folder, or with a robot file .ulg or a folder of tables"
)


def recordings_in(
    path: Path, robot: RobotFile | None = None, roles: Roles | None = None
) -> list[Path]:
    """Return the recordings at a path: itself, or those in a folder that is not a recording.

    With a robot file, or if each file is an episode, the tables in a folder are one recording.
    """
    if not path.is_dir() or _is_bag(path) or (path / lerobot_info.INFO).exists():
        return [path]
    files = [file for file in path.rglob('*') if file.is_file()]
    found = {file.parent for file in files if file.name == _METADATA}
    found |= {file.parents[1] for file in path.rglob(str(lerobot_info.INFO))}
    suffixes = _BAGS + hdf5.SUFFIXES + ulog.SUFFIXES + (arrow.SUFFIXES if robot is None else ())
    whole = arrow.SUFFIXES if roles is not None and roles.by_file else ()
    found |= {
        file.parent if file.suffix in whole else file
        for file in files
        if file.suffix in suffixes and found.isdisjoint(file.parents)
    }
    return sorted(found, key=lambda one: hdf5.natural(str(one))) or [path]


def _is_bag(path: Path) -> bool:
    return (path / _METADATA).exists() if path.is_dir() else path.suffix in _BAGS


def _check_that_it_has_data(path: Path) -> None:
    if not path.exists():
        raise RecordingError(f'{path} does not exist; {_EXPECTED}')
    if path.is_file() and not path.stat().st_size:
        raise RecordingError(f'{path} is empty')


def episodes_of_recording(
    source: str | Path | object,
    robot: RobotFile | None = None,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
    open_bag: OpenBag = open_bag,
    roles: Roles | None = None,
) -> RecordedEpisodes:
    """Return the complete episodes of a recording.

    Parameters
    ----------
    source : path, data frame, or mapping of str to data frame
        A bag, a file .parquet, .csv, .h5 or .hdf5, a folder of LeRobot, with roles a folder of
        tables, or with a robot file .ulg or a folder of tables; or tables in memory: of pandas, or
        anything that pyarrow accepts.
    robot : RobotFile, optional
        With one, tables are topics, named after their files or groups, and rows are messages.
        Without one, each row is a step; columns are named as in LeRobot, data sets as in Minari,
        robomimic or D4RL. For bags see `episodes_of_bag`.
    watch : callable, optional
        Wraps the iterable of messages, or frames of videos, given their number, to display
        progress.
    open_bag : callable, optional
        Opens bags, in place of rosbags.
    roles : Roles, optional
        What the columns of a table of steps are for, if it has names of its own.

    Raises
    ------
    RecordingError
        If the recording cannot be read or lacks something, or a package is missing.

    """
    if not isinstance(source, (str, Path)):
        if robot is None:
            name, table = 'the data frame', arrow.table_of(source)
            return (
                steps_by_roles(name, {name: table}, roles)
                if roles
                else lerobot.steps_in(name, table)
            )
        return _sampled('the data frames', _tables_of(source), robot, watch)
    path = Path(source)
    _check_that_it_has_data(path)
    if roles is not None:
        files = _tables_of_steps(path, robot)
        return steps_by_roles(path, {file: arrow.read(file) for file in files}, roles)
    if _is_bag(path):
        return episodes_of_bag(path, robot, watch, open_bag)
    if robot is None:
        return _steps_in(path, watch)
    with _tables_in(path) as tables:
        return _sampled(path, tables, robot, watch)


def robot_file_of_recording(
    path: Path,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
    open_bag: OpenBag = open_bag,
) -> str:
    """Return the text of a robot file with all channels of a bag or of tables of messages.

    Parameters
    ----------
    path, watch, open_bag
        As in `episodes_of_recording`.

    Raises
    ------
    RecordingError
        If the recording cannot be read, or its rows are steps, which need no robot file.

    """
    _check_that_it_has_data(path)
    if _is_bag(path):
        return robot_file_of_bag(path, watch, open_bag)
    if (path / lerobot_info.INFO).exists():
        raise RecordingError(f'{path} is a data set of LeRobot; it needs no robot file')
    bags = [one for one in recordings_in(path, None) if _is_bag(one)]
    if bags:
        raise RecordingError(f'{path} is a folder of bags; expected one of them, such as {bags[0]}')
    with _tables_in(path) as tables:
        read = {topic: table() for topic, table in tables.items()}
        seconds = _seconds(read.values())
        heard = [observed(topic, table, seconds) for topic, table in watch(read.items(), len(read))]
    return robot_file_of_topics(path.name, heard)


def _seconds(tables: Iterable[Table]) -> float:
    """Return the time from the first to the last row."""
    known = [table.times for table in tables if len(table.times)]
    return (max(t.max() for t in known) - min(t.min() for t in known)) / SECOND if known else 0.0


def _tables_of_steps(path: Path, robot: RobotFile | None) -> list[Path]:
    """Return a table itself, or those in a folder; raise RecordingError if there is none."""
    is_other = robot is not None or _is_bag(path) or (path / lerobot_info.INFO).exists()
    files = [] if is_other else [path] if path.is_file() else path.iterdir()
    found = [file for file in files if file.suffix in arrow.SUFFIXES]
    if not found:
        raise RecordingError(
            f'{path} {"is read by a robot file" if robot else "is not a table"}; --episode, '
            '--done, --reward, --action, --ignore and --gaps (Roles) are for tables whose rows are '
            'steps'
        )
    return sorted(found, key=lambda file: hdf5.natural(file.name))


def _steps_in(path: Path, watch: Callable[[Iterable, int], Iterable]) -> RecordedEpisodes:
    if path.is_file() and path.suffix in arrow.SUFFIXES:
        return lerobot.steps_in(path, arrow.read(path))
    if path.is_file() and path.suffix in hdf5.SUFFIXES:
        with hdf5.opened(path) as file:
            return hdf5.steps_in(path, file)
    if path.is_file() and path.suffix in ulog.SUFFIXES:
        raise RecordingError(f'{path} holds messages; expected a robot file (--robot) for it')
    if (path / lerobot_info.INFO).exists():
        table = arrow.joined(path, map(arrow.read, arrow.files_in(path / lerobot_info.DATA)))
        return lerobot.steps_in(path, table, lerobot_info.read_info(path), watch)
    raise RecordingError(f'{path} is not a recording; {_EXPECTED}')


@contextmanager
def _tables_in(path: Path) -> Iterator[Mapping[str, Callable[[], Table]]]:
    """Give the tables of messages in a recording, by topic."""
    if path.is_file() and path.suffix in hdf5.SUFFIXES:
        with hdf5.opened(path) as file:
            yield hdf5.tables_in(path, file)
        return
    if path.is_file() and path.suffix in ulog.SUFFIXES:
        yield ulog.tables_in(path)
        return
    files, above = arrow.files_in(path), path if path.is_dir() else path.parent
    if not files:
        raise RecordingError(f'{path} is not a recording; {_EXPECTED}')
    yield _by_topic(
        path,
        ((file.relative_to(above).with_suffix('').as_posix(), file, partial(_read, file))
         for file in files),
    )  # fmt: skip


def _read(file: Path) -> Table:
    return arrow.messages_of(str(file), arrow.read(file))


def _tables_of(source) -> dict[str, Callable[[], Table]]:
    named = source if isinstance(source, Mapping) else {'frame': source}
    return _by_topic(
        'the data frames',
        ((name.removeprefix('/'), name, partial(arrow.messages_of, name, arrow.table_of(frame)))
         for name, frame in named.items()),
    )  # fmt: skip


def _by_topic(
    path, tables: Iterable[tuple[str, object, Callable[[], Table]]]
) -> dict[str, Callable[[], Table]]:
    """Return tables by topic, from names without the first slash, sources and tables."""
    found: dict[str, Callable[[], Table]] = {}
    sources: dict[str, object] = {}
    for name, source, table in tables:
        topic = f'/{name}'
        if topic in found:
            raise RecordingError(
                f'{path}: {sources[topic]} and {source} are both the topic {topic}; expected one '
                'of them: rename or remove the other'
            )
        found[topic], sources[topic] = table, source
    return found


def _sampled(
    path,
    tables: Mapping[str, Callable[[], Table]],
    robot: RobotFile,
    watch: Callable[[Iterable, int], Iterable],
) -> RecordedEpisodes:
    """Return the episodes from tables according to a robot file; only tables it names are read."""
    if len(tables) == len(robot.topics) == 1:  # A single table is used under any name.
        tables = {f'/{robot.topics[0].removeprefix("/")}': next(iter(tables.values()))}
    collector = SampledEpisodes(robot)
    topics = collector.topics_among(dict.fromkeys(tables, ()), path)
    read = {topic: tables[topic]() for topic in topics}
    total = sum(len(table.times) for table in read.values())
    messages = heapq.merge(*map(_of_topic, read.items()), key=itemgetter(0))
    for time, topic, message in watch(messages, total):
        collector.add(topic, message, time)
    traffic = Traffic(
        _seconds(read.values()),
        {name: len(read[topic].times) for topic, name in topics.items()},
        {name: read[topic].num_bytes for topic, name in topics.items()},
    )
    return collector.recorded(total, traffic, {})


def _of_topic(named: tuple[str, Table]) -> Iterator[tuple[int, str, object]]:
    topic, table = named
    for time, message in table.messages():
        yield time, topic, message
