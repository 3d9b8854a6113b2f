# SPDX-License-Identifier: Apache-2.0

"""HDF5 files, read by h5py, which is optional: pip install h5py.

Without a robot file, a file is a data set of steps as written by Minari, robomimic, D4RL or ALOHA:
groups `observations` or `obs`, `actions` or `action`, and `rewards`. With a robot file, its groups
are tables of messages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core.words import first

from .steps import WHOLE, Names, Steps, episodes_of_steps
from .table import NANOSECONDS, SECONDS, STAMP, Column, Table, times_of

SUFFIXES = ('.h5', '.hdf5')
_STATES, _ACTIONS, _REWARDS = ('observations', 'obs'), ('actions', 'action'), ('rewards', 'reward')
#: Data sets by which D4RL marks the last steps of episodes in one long array.
_ENDS = ('terminals', 'timeouts')
#: With more bytes in a step, a data set is a compressed picture.
_MOST_BYTES = 1000


@contextmanager
def opened(path: Path) -> Iterator:
    """Open a file; raise RecordingError if it cannot be opened."""
    try:
        from h5py import File
    except ImportError as error:
        raise RecordingError('HDF5 needs h5py: pip install h5py') from error
    try:
        file = File(path)
    except OSError as error:
        what = ' '.join(str(error).split())[:300]
        raise RecordingError(f'{path} cannot be read as HDF5: {what}') from error
    with file:
        yield file


def tables_in(path, file) -> dict[str, Callable[[], Table]]:
    """Return the tables of messages in an open file, by the paths of their groups.

    Raises
    ------
    RecordingError
        If there are none.

    """
    groups = {f'/{path.stem}': file}
    file.visititems(lambda name, item: groups.update({f'/{name}': item}))
    groups = {name: group for name, group in groups.items() if _has_times(group)}
    if not groups:
        raise RecordingError(
            f'{path} has no group with a data set {SECONDS}, {NANOSECONDS} or {STAMP[0]}; with a '
            'robot file its groups are tables of messages; without one, rows are steps'
        )
    return {name: partial(_table, f'{path}: {name}', group) for name, group in groups.items()}


def _has_times(group) -> bool:
    return _is_group(group) and any(
        getattr(group.get(name), 'shape', None)
        for part in (SECONDS, NANOSECONDS, STAMP[0])
        for name in (part, part.replace('.', '/'))
    )


def _is_group(found) -> bool:
    return hasattr(found, 'keys')


def _datasets(group) -> dict:
    """Return the data sets in a group by their names below it, joined by dots."""
    found: dict = {}
    group.visititems(
        lambda name, item: found.update({} if _is_group(item) else {name.replace('/', '.'): item})
    )
    return found


def _table(name: str, group) -> Table:
    found = {key: item for key, item in _datasets(group).items() if _is_column(item)}
    told = {part: found[part] for part in (SECONDS, NANOSECONDS, *STAMP) if part in found}
    num_rows = len(next(iter(told.values())))
    for key, item in found.items():
        if len(item) != num_rows:
            raise RecordingError(
                f'{name} has {num_rows} times, but {key} has {len(item)} rows; expected as many'
            )
    times = times_of(name, {part: item[:] for part, item in told.items()})
    num_bytes = sum(item.nbytes for item in found.values())
    return Table(name, {key: _column(item) for key, item in found.items()}, times, num_bytes)


def _is_column(item) -> bool:
    """Return whether each row is a text, a number or a list of numbers; pictures are not."""
    from h5py import check_string_dtype, check_vlen_dtype

    kind = item.dtype
    is_known = kind.kind in 'biuf' or check_string_dtype(kind) or check_vlen_dtype(kind)
    return bool(is_known and item.shape and item.ndim <= 2)


def _column(item) -> Column:
    from h5py import check_string_dtype

    values = item.asstr() if check_string_dtype(item.dtype) else item
    return Column(lambda begin, end: values[begin:end], item.nbytes, len(item))


def steps_in(path, file) -> RecordedEpisodes:
    """Return the episodes of an open data set.

    Raises
    ------
    RecordingError
        If it has no group of states, or its arrays are of different lengths.

    """
    groups = {name: group for name, group in _groups(file).items() if _part(group, _STATES)}
    if not groups:
        raise RecordingError(
            f'{path} has no group of {" or ".join(_STATES)}, as Minari, robomimic and D4RL write '
            f'them; it has {first(list(file)) or "nothing"}. Groups of messages, each with '
            f'a data set {SECONDS}, need a robot file (--robot)'
        )
    unreadable: dict[str, str] = {}
    steps, num_open = [], 0
    for name, group in groups.items():
        whole = _steps(f'{path}: {name}', group, unreadable)
        parts, num_rest = _split(whole, group)
        steps += parts
        num_open += num_rest
    why = f'no data set {" or ".join(_REWARDS)}'
    return episodes_of_steps(
        path, steps, Names('obs'), why, {}, unreadable=unreadable, num_open_steps=num_open
    )


def _groups(file) -> dict:
    """Return groups that may be episodes: the file, its groups, and those of `data`, in order."""
    found = {'the file': file}
    for above in (file, file.get('data')):
        if _is_group(above):
            found |= {name: above[name] for name in sorted(above, key=natural)}
    return {name: group for name, group in found.items() if _is_group(group)}


def natural(name: str) -> list:
    """Return a key that sorts demo_2 before demo_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r'(\d+)', name)]


def _part(group, names: tuple[str, ...]):
    return next((group[name] for name in names if name in group), None)


def _steps(name: str, group, unreadable: dict[str, str]) -> Steps:
    states = _numbers(_part(group, _STATES), unreadable)
    if not states:
        raise RecordingError(f'{name} has no numeric states; {_said(unreadable)}')
    actions = _part(group, _ACTIONS)
    found_actions = {} if actions is None else _numbers(actions, unreadable)
    rewards = _part(group, _REWARDS)
    values = {} if rewards is None else {'rewards': _vector(name, rewards)}
    sizes = {f'action {key}'.strip(): len(part) for key, part in found_actions.items()}
    sizes |= {key: len(part) for key, part in values.items()}
    count = next(iter(sizes.values()), len(next(iter(states.values()))))
    for key, part in states.items():
        # There may also be the state after the last step.
        sizes[f'state {key}'.strip()] = len(part) - (len(part) == count + 1)
    wrong = [f'{key} {size}' for key, size in sizes.items() if size != count]
    if wrong:
        raise RecordingError(
            f'{name} has {count} steps by its {next(iter(sizes))}, but {first(wrong)}; expected '
            'the same number of each, or one state more'
        )
    states = {key: part[:count] for key, part in states.items()}
    return Steps(name, states, found_actions, values.get('rewards'))


def _said(unreadable: Mapping[str, str]) -> str:
    return first([f'{key}: {why}' for key, why in unreadable.items()]) or 'it is empty'


def _vector(name: str, item) -> np.ndarray:
    """Return a data set with a number for each step, shape (T,)."""
    if _is_group(item) or not item.shape or item.dtype.kind not in 'biuf':
        raise RecordingError(f'{name}: {item.name} is no array; expected a number for each step')
    return item[:].ravel()


def _numbers(found, unreadable: dict[str, str]) -> dict[str, np.ndarray]:
    """Return the arrays of an observation or action by key; note what is left out."""
    items = _datasets(found) if _is_group(found) else {WHOLE: found}
    numbers = {}
    for key, item in items.items():
        if item.dtype.kind not in 'biuf':
            unreadable[key or item.name] = 'it has no numbers'
        elif _is_pictures(key, item):
            unreadable[key or item.name] = 'images are not read'
        elif item.ndim:
            numbers[key] = item[:]
    return numbers


def _is_pictures(key: str, item) -> bool:
    """Return whether a data set holds pictures, as pixels or, as by ALOHA, as compressed bytes."""
    is_wide = item.ndim == 2 and (item.shape[1] > _MOST_BYTES or 'images' in key.split('.'))
    return item.ndim > 2 or (is_wide and item.dtype == np.uint8)


def _split(steps: Steps, group) -> tuple[list[Steps], int]:
    """Return the episodes of a long array with marked ends, and the number of steps after them."""
    marks = {key: _vector(steps.name, group[key]) for key in _ENDS if key in group}
    if not marks:
        return [steps], 0
    for key, values in marks.items():
        if len(values) != len(steps):
            raise RecordingError(
                f'{steps.name} has {len(steps)} steps, but {key} {len(values)}; expected as many'
            )
    ends = np.flatnonzero(np.any([values > 0 for values in marks.values()], axis=0)) + 1
    begins = [0, *ends][: len(ends)]
    parts = [
        Steps(
            f'{steps.name}, steps {begin} to {end - 1}',
            {key: values[begin:end] for key, values in steps.states.items()},
            {key: values[begin:end] for key, values in steps.actions.items()},
            None if steps.rewards is None else steps.rewards[begin:end],
        )
        for begin, end in zip(begins, ends, strict=True)
    ]
    return parts, len(steps) - int(ends[-1] if len(ends) else 0)
