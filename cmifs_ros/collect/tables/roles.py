# SPDX-License-Identifier: Apache-2.0

"""Read tables of steps whose columns have names of the user's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core.words import listed

from .columns import Columns, until
from .steps import Names, Steps, episodes_of_steps


@dataclass(frozen=True)
class Roles:
    """What the columns of a table of steps are for; all other columns are sensors.

    Attributes
    ----------
    episode : str, optional
        Names or numbers the episode of each row.
    done : str or sequence of str
        Any of them is true at the last step of an episode, in place of `episode`. With neither, a
        table is an episode.
    reward : str, optional
        The reward of each step.
    action : str or sequence of str
        The actions.
    ignore : str or sequence of str
        Columns that are left out.
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

    def __post_init__(self):
        for role in ('done', 'action', 'ignore'):
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
        return [*single, *self.done, *self.action, *self.ignore]


def steps_by_roles(path, table, roles: Roles) -> RecordedEpisodes:
    """Return the episodes of an Arrow table of steps.

    Parameters
    ----------
    path : object
        For messages.
    table : pyarrow.Table
    roles : Roles

    Raises
    ------
    RecordingError
        If it lacks a column, one has no numbers where they are needed, or an episode has several
        sources.

    """
    columns = Columns(path, table)
    lacking = [name for name in roles.columns if name not in columns.names]
    if lacking:
        raise RecordingError(
            f'{path} has no column {listed(lacking)}; expected some of {listed(columns.names)}'
        )
    others = {name: columns.numbers(name) for name in columns.names if name not in roles.columns}
    states = {name: values for name, values in others.items() if values is not None}
    if not states:
        raise RecordingError(f'{path} has no sensors: no column without a role holds numbers')
    unreadable = dict(columns.unreadable)
    actions = {name: _needed(columns, name) for name in roles.action}
    rewards = _needed(columns, roles.reward) if roles.reward else None
    if roles.episode:
        named = {
            f'{roles.episode} {name}': of for name, of in columns.by_value(roles.episode).items()
        }
    elif roles.done:
        ends = np.any([_needed(columns, name) > 0 for name in roles.done], axis=0)
        named = {f'episode {i}': rows for i, rows in enumerate(until(ends))}
    else:
        named = {'the table': np.arange(len(table))}
    sources = np.full(len(table), '', dtype=object)
    for source, rows in columns.by_value(roles.source).items() if roles.source else ():
        sources[rows] = source
    for name, rows in named.items():
        several = sorted(set(sources[rows]))
        if len(several) > 1:
            raise RecordingError(
                f'{path}: {name} has rows of {listed(several)} in the column {roles.source}; '
                'expected one source for each episode'
            )
    parts = [
        Steps(
            name,
            {key: values[rows] for key, values in states.items()},
            {key: values[rows] for key, values in actions.items()},
            None if rewards is None else rewards[rows],
            source=next(iter(sources[rows]), ''),
        )
        for name, rows in named.items()
    ]
    return episodes_of_steps(
        path, parts, Names('state'), 'no column for the reward (--reward)', {},
        num_open_steps=len(table) - sum(map(len, parts)), unreadable=unreadable,
    )  # fmt: skip


def _needed(columns: Columns, name: str) -> np.ndarray:
    found = columns.numbers(name)
    if found is None:
        raise RecordingError(f'{columns.path}: column {name}: {columns.unreadable[name]}')
    return found
