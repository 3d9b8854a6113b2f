# SPDX-License-Identifier: Apache-2.0

"""Episodes of several bags together: in the order of time, and what was recorded twice once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path

import numpy as np

from cmifs_ros.collect.bag import BagEpisodes, BagError
from cmifs_ros.collect.episodes.same_actions import with_same_actions
from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted

#: Of the steps of two bags at the same times, the share with the same values by which they are
#: recordings of the same run. Two recorders receive messages without a stamp in different order, so
#: not all have.
_SAME = 0.5
#: Share of the steps of a bag at the times of another's by which they overlap.
_OVERLAP = 0.05


@dataclass
class Pool:
    """Episodes of several bags.

    Attributes
    ----------
    channel_names : tuple of str
    episodes : list of Episode
        In the order of time of the bags, each with its source.
    step_seconds : float
        The median time from one step to the next; NaN if no episode has two.
    notes : list of str
        What was left out, and what is doubtful.
    action_names : tuple of str
        Of the values of the actions; empty if some episodes have none.

    """

    channel_names: tuple[str, ...] = ()
    episodes: list[Episode] = field(default_factory=list)
    step_seconds: float = float('nan')
    notes: list[str] = field(default_factory=list)
    action_names: tuple[str, ...] = ()


def source_of(path: str | Path, by: str) -> str:
    """Return which robot or recording a bag is of.

    Parameters
    ----------
    path : path-like
    by : str
        One of `cmifs_ros.collect.robot_file.model.SOURCES`.

    """
    whole = Path(path).absolute()
    return {'none': '', 'bag': str(whole), 'folder': str(whole.parent)}[by]


def pooled(bags: Sequence[tuple[str, BagEpisodes]], by: str = 'none') -> Pool:
    """Return the episodes of bags together.

    A step counts once: an episode with a step that a bag before has, at the same time and with the
    same values, is left out, as of a second recorder or of a trimmed copy.

    Parameters
    ----------
    bags : sequence of (str, BagEpisodes)
        With their paths.
    by : str
        What tells the sources apart, see `source_of`.

    Raises
    ------
    BagError
        If the bags differ in their channels.

    """
    pool = Pool()
    kept: list[_Recorded] = []
    with_episodes = [(path, bag) for path, bag in bags if bag.episodes]
    steps = [np.diff(stamps) for _, bag in with_episodes for stamps in bag.stamps]
    if sum(map(len, steps)):
        pool.step_seconds = float(np.median(np.concatenate(steps))) / 1e9
    for path, bag in sorted(with_episodes, key=lambda item: item[1].stamps[0][0]):
        if bag.channel_names != (pool.channel_names or bag.channel_names):
            raise BagError(f'{path} has other channels than {kept[0].path}; expected the same')
        if pool.action_names and bag.action_names not in ((), pool.action_names):
            raise BagError(f'{path} has other actions than {kept[0].path}; expected the same')
        pool.channel_names = bag.channel_names
        recorded = _Recorded(path, source_of(path, by), bag, [True] * len(bag.episodes))
        repeated = np.zeros(len(recorded.stamps), bool)
        for other in kept:
            at_same_time, same = recorded.compared(other, pool.step_seconds * 1e9)
            if same.sum() >= _SAME * at_same_time.sum() > 0:
                repeated |= same
                pool.notes.append(
                    f'{path} has {counted(int(same.sum()), "step")} of {other.path} a second time'
                )
            elif at_same_time.mean() > _OVERLAP and recorded.source == other.source:
                pool.notes.append(
                    f'{path} and {other.path} overlap in time, with other values: of two robots, '
                    'or two simulated runs, tell the sources apart (--source bag)'
                )
        is_kept = [not part.any() for part in np.split(repeated, recorded.ends[:-1])]
        if not all(is_kept):
            pool.notes.append(
                f'{path}: {is_kept.count(False)} of {counted(len(is_kept), "episode")} left out, '
                'as they were recorded twice'
            )
        if any(is_kept):
            kept.append(_Recorded(path, recorded.source, bag, is_kept))
            episodes = compress(bag.episodes, is_kept)
            pool.episodes += [replace(episode, source=recorded.source) for episode in episodes]
            pool.action_names = pool.action_names or bag.action_names
    pool.episodes, note = with_same_actions(pool.episodes)
    pool.notes += [note] if note else []
    if pool.episodes and not pool.episodes[0].actions.size:
        pool.action_names = ()
    return pool


class _Recorded:
    """The steps of a bag's episodes, one after the other."""

    def __init__(self, path: str, source: str, bag: BagEpisodes, which: Sequence[bool]):
        self.path, self.source = path, source
        episodes = list(compress(bag.episodes, which))
        self.stamps = np.concatenate(list(compress(bag.stamps, which)))
        self.states = np.concatenate([episode.states for episode in episodes])
        self.ends = np.cumsum([len(episode) for episode in episodes])
        self._order = np.argsort(self.stamps, kind='stable')

    def compared(self, other: _Recorded, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which steps another bag has a step beside, and which with the same values.

        Parameters
        ----------
        other : _Recorded
        step : float
            How far apart two steps are, in nanoseconds.

        Returns
        -------
        at_same_time, same : numpy.ndarray of bool, shape (steps,)

        """
        times = other.stamps[other._order]
        after = np.searchsorted(times, self.stamps)
        at_same_time = np.zeros(len(self.stamps), bool)
        same = np.zeros(len(self.stamps), bool)
        for place in (after - 1, after):
            neighbour = np.clip(place, 0, len(times) - 1)
            is_near = abs(times[neighbour] - self.stamps) < step
            at_same_time |= is_near
            values = other.states[other._order[neighbour]]
            same |= is_near & (values == self.states).all(axis=1)
        return at_same_time, same
