# SPDX-License-Identifier: Apache-2.0

"""Read tables of steps with the column names of LeRobot (v2.1 and v3).

`observation.*` are the states, `action` or `action.*` the actions; `next.reward` is the reward. If
it is missing, the last step has the success of the episode as its reward. `episode_index` separates
the episodes, or `next.done` marks their ends. The videos and images of a folder are cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from functools import partial

import numpy as np

from cmifs_ros.collect.encoders import Image
from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.collect.sampling.bag_reader import unwatched
from cmifs_ros.core.words import first

from . import arrow, images, videos
from .columns import Columns, until
from .lerobot_info import DATA, Info
from .steps import WHOLE, Names, Steps, episodes_of_steps

_STATE, _ACTION = 'observation', 'action'
_EPISODE, _FRAME, _DONE = 'episode_index', 'frame_index', 'next.done'
_REWARD, _SUCCESS, _TIME = 'next.reward', 'next.success', 'timestamp'
#: What a column of pictures is called in the metadata, in files of videos or in the table.
_CAMERAS = _VIDEO, _IMAGE = ('video', 'image')


def steps_in(
    path,
    table,
    info: Info | None = None,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
) -> RecordedEpisodes:
    """Return the episodes of an Arrow table of steps.

    Parameters
    ----------
    path : object
        For messages.
    table : pyarrow.Table
    info : Info, optional
        The metadata, if it is of a data set's folder.
    watch : callable, optional
        Wraps the iterable of the frames of a video, given their number, to display progress.

    Raises
    ------
    RecordingError
        If it lacks states or a column that separates episodes, or rows of a column differ in
        length.

    """
    info = info or Info()
    columns = Columns(path, table)
    states, actions = _below(columns, _STATE), _below(columns, _ACTION)
    found = _episodes(columns)
    if found is None or not (states or info.columns(*_CAMERAS)):
        raise RecordingError(
            f'{path} has the columns {first(table.column_names)}; expected {_STATE}.* of numbers '
            f'and {_EPISODE} or {_DONE}, as LeRobot has them. If its rows are steps with names of '
            'your own, say what the columns are for: --episode or --done, --reward, --action. If '
            'its rows are messages, give a robot file: --robot'
        )
    rewards, success = columns.numbers(_REWARD), columns.numbers(_SUCCESS)
    frames = columns.numbers(_FRAME)
    whole = {
        number: rows
        for number, rows in found.items()
        if frames is None or (frames[rows] == np.arange(len(rows))).all()
    }
    of_states = _names(info, _STATE)
    pictures: dict[str, dict[int, Callable[[int], np.ndarray]]] = {}
    for column in info.columns(*_CAMERAS):
        key = _key(column, _STATE, info.features) or column
        try:
            states[key], pictures[key] = _encoded(info, column, columns, whole, watch)
            of_states[key] = list(Image().suffixes)
        except RecordingError as error:
            columns.unreadable[column] = str(error)
    if not states:
        raise RecordingError(f'{path} has no states: {"; ".join(columns.unreadable.values())}')
    parts = [
        Steps(
            f'episode {number}',
            {key: values[rows] for key, values in states.items()},
            {key: values[rows] for key, values in actions.items()},
            _rewards(rewards, success, rows),
            {key: of_episodes[number] for key, of_episodes in pictures.items()},
        )
        for number, rows in whole.items()
    ]
    num_gaps = len(found) - len(whole)
    return episodes_of_steps(
        path, parts, Names('state', of_states, _names(info, _ACTION)),
        f'no column {_REWARD} or {_SUCCESS}',
        {f'episodes of which {_FRAME} misses a step': num_gaps} if num_gaps else {},
        step_seconds=info.step_seconds, num_open_steps=len(table) - sum(map(len, found.values())),
        unreadable=columns.unreadable,
    )  # fmt: skip


def _encoded(
    info: Info,
    column: str,
    columns: Columns,
    rows: Mapping[int, np.ndarray],
    watch: Callable[[Iterable, int], Iterable],
) -> tuple[np.ndarray, dict[int, Callable[[int], np.ndarray]]]:
    """Return the encoded frames of a camera, and by episode what returns its pictures."""
    if column in info.columns(_IMAGE):
        files = arrow.files_in(info.folder / DATA)
        values = images.encoded(files, column, Image(), watch)
        return values, {n: partial(images.picture, files, column, rows[n]) for n in rows}
    times = columns.complete(_TIME)
    if times is None:
        raise RecordingError(f'its frames have no times: there is no column {_TIME}')
    shots = info.shots(column, rows)
    values = videos.encoded(shots, rows, times, Image(), watch)
    return values, {n: partial(videos.picture, shots[n], times[rows[n]]) for n in rows}


def _below(columns: Columns, start: str) -> dict[str, np.ndarray]:
    """Return all columns whose names begin with a prefix, by the rest of the name."""
    keys = {name: _key(name, start, columns.names) for name in columns.names}
    found = {key: columns.numbers(name) for name, key in keys.items() if key is not None}
    return {key: values for key, values in found.items() if values is not None}


def _key(name: str, start: str, names: Container[str]) -> str | None:
    """Return the name of a column among others after a prefix; None if it has another prefix."""
    if name == start or (name == f'{start}.state' and start not in names):
        return WHOLE
    return name[len(start) + 1 :] if name.startswith(f'{start}.') else None


def _episodes(columns: Columns) -> dict[int, np.ndarray] | None:
    """Return the rows of each complete episode by number; None if no column separates them."""
    numbers, frames = columns.complete(_EPISODE), columns.numbers(_FRAME)
    if numbers is not None:
        order = np.lexsort((np.arange(len(numbers)) if frames is None else frames, numbers))
        found, begins = np.unique(numbers[order], return_index=True)
        rows = np.split(order, begins)[1:]
        return {int(number): part for number, part in zip(found, rows, strict=True)}
    done = columns.complete(_DONE)
    if done is None:
        return None
    return dict(enumerate(until(done)))


def _rewards(
    rewards: np.ndarray | None, success: np.ndarray | None, rows: np.ndarray
) -> np.ndarray | None:
    if rewards is not None:
        return rewards[rows].ravel()
    if success is None:
        return None
    rewards = np.zeros(len(rows))
    rewards[-1] = (success[rows] > 0).any()
    return rewards


def _names(info: Info, start: str) -> dict[str, list[str]]:
    """Return the names of numbers by key: from a list, lists in a mapping, or its keys."""
    found = {}
    for name, said in info.features.items():
        key, names = _key(name, start, info.features), said.get('names')
        if isinstance(names, Mapping):
            of_all = [part for part in names.values() if isinstance(part, list)]
            names = [part for parts in of_all for part in parts] if of_all else list(names)
        if key is not None and isinstance(names, list):
            found[key] = [str(part) for part in names]
    return found
