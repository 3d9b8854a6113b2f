# SPDX-License-Identifier: Apache-2.0

"""Read tables of steps whose columns have names of the user's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core.words import did_you_mean, listed, short

from . import arrow
from .columns import Columns, until
from .steps import Names, Steps, episodes_of_steps

#: If more rows than this stay together on average, rows of several robots are not mixed.
_FEW_ROWS = 4


@dataclass(frozen=True)
class Roles:
    """What the columns of a table of steps are for; all other columns are sensors.

    Attributes
    ----------
    episode : str, optional
        Names or numbers the episode of each row.
    done : str or sequence of str
        Any of them is true at the last step of an episode, in place of `episode`. With neither,
        each file is an episode.
    reward : str, optional
        The reward of each step.
    action : str or sequence of str
        The actions.
    ignore : str or sequence of str
        Columns that are left out.
    gaps : str or sequence of str
        Sensors that may have no value, such as the pose of a tag that is not always seen: the last
        value of the episode holds, 0 before the first, and a channel says whether there is one.
    source : str, optional
        Names the robot or recording of each episode: each may have its own mean.

    Raises
    ------
    ValueError
        If a column has two roles, or both `episode` and `done` are given.

    """

    episode: str | None = None
    done: str | Sequence[str] = ()
    reward: str | None = None
    action: str | Sequence[str] = ()
    ignore: str | Sequence[str] = ()
    source: str | None = None
    gaps: str | Sequence[str] = ()

    def __post_init__(self):
        for role in ('done', 'action', 'ignore', 'gaps'):
            given = getattr(self, role)
            object.__setattr__(self, role, (given,) if isinstance(given, str) else tuple(given))
        if self.episode and self.done:
            raise ValueError(
                f'episodes are separated by {self.episode} and by {listed(self.done)}; '
                'expected either episode or done'
            )
        twice = sorted({name for name in self.columns if self.columns.count(name) > 1})
        if twice:
            raise ValueError(f'column {listed(twice)} has two roles; expected one')

    @property
    def columns(self) -> list[str]:
        """All columns with a role."""
        single = [name for name in (self.episode, self.reward, self.source) if name]
        return [*single, *self.done, *self.action, *self.ignore, *self.gaps]

    @property
    def by_file(self) -> bool:
        """Whether each file is an episode."""
        return not self.episode and not self.done


def steps_by_roles(path, tables: Mapping[object, Any], roles: Roles) -> RecordedEpisodes:
    """Return the episodes of Arrow tables of steps.

    Parameters
    ----------
    path : object
        Of all, for messages.
    tables : mapping of object to pyarrow.Table
        By path. An episode does not go beyond its table.
    roles : Roles

    Raises
    ------
    RecordingError
        If they lack a column, one has no numbers where they are needed, or an episode has several
        sources.

    """
    table = arrow.joined(path, tables.values())
    columns = Columns(path, table)
    for name in roles.columns:
        if name not in columns.names:
            raise RecordingError(
                f'{path} has no column {short(name)}{did_you_mean(name, columns.names)}; expected '
                f'some of {listed(columns.names)}'
            )
    others = {name: columns.numbers(name) for name in columns.names if name not in roles.columns}
    states = {name: values for name, values in others.items() if values is not None}
    gaps = {name: _needed(columns, name) for name in roles.gaps}
    if not states and not gaps:
        raise RecordingError(f'{path} has no sensors: no column without a role holds numbers')
    unreadable = dict(columns.unreadable)
    actions = {name: _needed(columns, name) for name in roles.action}
    rewards = _needed(columns, roles.reward) if roles.reward else None
    parts, begin, num_breaks = [], 0, 0
    for one, of_one in tables.items():
        for name, source, places in _episodes(Columns(one, of_one), roles):
            num_breaks += int(np.count_nonzero(np.diff(places) > 1))
            rows = begin + places
            parts.append(
                Steps(
                    f'{name} of {one}' if len(tables) > 1 else name,
                    {key: values[rows] for key, values in states.items()}
                    | {key: _held(values[rows]) for key, values in gaps.items()},
                    {key: values[rows] for key, values in actions.items()},
                    None if rewards is None else rewards[rows],
                    source=source,
                )
            )
        begin += len(of_one)
    notes = []
    if 0 < num_breaks * _FEW_ROWS < len(table):
        notes.append(
            f'rows of episodes do not follow each other, in {num_breaks} places: if the numbers in '
            f'{roles.episode} begin again, as in joined runs, number the episodes anew'
        )
    names = Names('state', {name: _names_of_gaps(values) for name, values in gaps.items()})
    return episodes_of_steps(
        path, parts, names, 'no column for the reward (--reward)', {},
        remedy=' (--gaps keeps them, --ignore leaves the sensor out)',
        num_open_steps=len(table) - sum(map(len, parts)), unreadable=unreadable,
        notes=tuple(notes),
    )  # fmt: skip


def _episodes(columns: Columns, roles: Roles) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield the name, the source and the rows of each episode of a table."""
    if roles.episode:
        named = {
            f'{roles.episode} {name}': of for name, of in columns.by_value(roles.episode).items()
        }
    elif roles.done:
        ends = np.any([_needed(columns, name) > 0 for name in roles.done], axis=0)
        named = {f'episode {i}': rows for i, rows in enumerate(until(ends))}
    else:
        named = {'the table': np.arange(len(columns))} if len(columns) else {}
    sources = np.full(len(columns), '', dtype=object)
    for source, rows in columns.by_value(roles.source).items() if roles.source else ():
        sources[rows] = source
    for name, rows in named.items():
        several = sorted(set(sources[rows]))
        if len(several) > 1:
            raise RecordingError(
                f'{columns.path}: {name} has rows of {listed(several)} in the column '
                f'{roles.source}; expected one source for each episode'
            )
        yield name, next(iter(several), ''), rows


def _needed(columns: Columns, name: str) -> np.ndarray:
    found = columns.numbers(name)
    if found is None:
        raise RecordingError(f'{columns.path}: column {name}: {columns.unreadable[name]}')
    return found


def _held(values: np.ndarray) -> np.ndarray:
    """Return the last known values of a sensor with gaps, and whether it has one, shape (T, n + 1).

    Nothing of later steps enters.
    """
    values = np.asarray(values, float).reshape(len(values), -1)
    is_known = ~np.isnan(values).any(axis=1)
    last = np.maximum.accumulate(np.where(is_known, np.arange(len(values)), -1))
    return np.column_stack([np.where(last[:, None] < 0, 0.0, values[last]), is_known])


def _names_of_gaps(values: np.ndarray) -> list[str]:
    parts = ['value'] if values.ndim == 1 else [f'[{i}]' for i in range(values.shape[1])]
    return [*parts, 'seen']
