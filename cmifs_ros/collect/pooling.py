# SPDX-License-Identifier: Apache-2.0

"""Pool the episodes of several recordings in the order of time, without repetitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path

import numpy as np

from cmifs_ros.collect.episodes.same_actions import with_same_actions
from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted

#: Two recordings are of the same run if at least this share of their simultaneous steps has equal
#: values. Not all have: two recorders may receive messages without a stamp in different order.
_SAME = 0.5
#: Two recordings overlap if at least this share of the steps of one is simultaneous with the
#: other's.
_OVERLAP = 0.05


@dataclass
class Pool:
    """Episodes of several recordings.

    Attributes
    ----------
    channel_names : tuple of str
    episodes : list of Episode
        In the order of their recordings' time, each with its source.
    step_seconds : float
        Median time between steps; NaN if no episode has two.
    notes : list of str
        What was left out, and what looks wrong.
    action_names : tuple of str
        Names of the values of an action; empty if some episodes have no actions.
    origins : list of (int, int)
        The recording of each episode, and which one it is of that.

    """

    channel_names: tuple[str, ...] = ()
    episodes: list[Episode] = field(default_factory=list)
    step_seconds: float = float('nan')
    notes: list[str] = field(default_factory=list)
    action_names: tuple[str, ...] = ()
    origins: list[tuple[int, int]] = field(default_factory=list)


def source_of(path: str | Path, by: str) -> str:
    """Return the name of the source, a robot or a recording, that a recording belongs to.

    Parameters
    ----------
    path : path-like
    by : str
        One of `cmifs_ros.collect.robot_file.model.SOURCES`.

    """
    whole = Path(path).absolute()
    return {'none': '', 'bag': str(whole), 'folder': str(whole.parent)}[by]


def pooled(recordings: Sequence[tuple[str, RecordedEpisodes]], by: str = 'none') -> Pool:
    """Return the episodes of several recordings.

    Each step counts once: if an earlier recording has one with the same time and values, as with a
    second recorder or a trimmed copy, the episode is left out. If a recording has no times, its
    episodes are left out if another recording has the same complete episode.

    Parameters
    ----------
    recordings : sequence of (str, RecordedEpisodes)
        Paths and contents. Those without times come last, in the given order.
    by : str
        What distinguishes the sources, see `source_of`.

    Raises
    ------
    RecordingError
        If the recordings differ in their channels or actions.

    """
    pool = Pool()
    kept: list[_Recorded] = []
    numbered = [(i, path, one) for i, (path, one) in enumerate(recordings) if one.episodes]
    distances = np.concatenate([np.empty(0), *(one.distances for _, _, one in numbered)])
    if len(distances):
        pool.step_seconds = float(np.median(distances)) / 1e9
    for number, path, one in sorted(numbered, key=lambda item: _begin(item[2])):
        if one.channel_names != (pool.channel_names or one.channel_names):
            raise RecordingError(
                f'{path} has other channels than {kept[0].path}; expected the same'
            )
        if pool.action_names and one.action_names not in ((), pool.action_names):
            raise RecordingError(f'{path} has other actions than {kept[0].path}; expected the same')
        pool.channel_names = one.channel_names
        recorded = _Recorded(path, source_of(path, by), one, [True] * len(one.episodes))
        is_kept = recorded.not_in(kept, pool)
        if not all(is_kept):
            pool.notes.append(
                f'{path}: {is_kept.count(False)} of {counted(len(is_kept), "episode")} left out, '
                'because they were recorded twice'
            )
        if any(is_kept):
            kept.append(_Recorded(path, recorded.source, one, is_kept))
            new = compress(one.episodes, is_kept)
            pool.episodes += [replace(episode, source=recorded.source) for episode in new]
            pool.action_names = pool.action_names or one.action_names
            pool.origins += [(number, i) for i in np.flatnonzero(is_kept).tolist()]
    episodes, note = with_same_actions(pool.episodes)
    if len(episodes) < len(pool.episodes):
        pool.origins = list(compress(pool.origins, [e.actions.size for e in pool.episodes]))
    pool.episodes = episodes
    pool.notes += [note] if note else []
    if pool.episodes and not pool.episodes[0].actions.size:
        pool.action_names = ()
    return pool


def _begin(recording: RecordedEpisodes) -> float:
    return float('inf') if recording.stamps is None else recording.stamps[0][0]


class _Recorded:
    """The steps of a recording's episodes, concatenated."""

    def __init__(self, path: str, source: str, recording: RecordedEpisodes, which: Sequence[bool]):
        self.path, self.source = path, source
        self._episodes = list(compress(recording.episodes, which))
        self._has_times = recording.stamps is not None
        if recording.stamps is not None:
            self._stamps = np.concatenate(list(compress(recording.stamps, which)))
            self._states = np.concatenate([episode.states for episode in self._episodes])
            self._order = np.argsort(self._stamps, kind='stable')

    def not_in(self, others: Sequence[_Recorded], pool: Pool) -> list[bool]:
        """Return which episodes are not in others; add notes about what looks wrong."""
        if not self._has_times:
            known = {_content(e) for other in others for e in other._episodes}
            return [_content(episode) not in known for episode in self._episodes]
        repeated = np.zeros(len(self._stamps), bool)
        for other in (other for other in others if other._has_times):
            at_same_time, same = self._compared(other, pool.step_seconds * 1e9)
            if same.sum() >= _SAME * at_same_time.sum() > 0:
                repeated |= same
                pool.notes.append(
                    f'{self.path} repeats {counted(int(same.sum()), "step")} of {other.path}'
                )
            elif at_same_time.mean() > _OVERLAP and self.source == other.source:
                pool.notes.append(
                    f'{self.path} and {other.path} overlap in time but differ in values; if they '
                    'are from two robots or two simulated runs, use --source bag'
                )
        ends = np.cumsum([len(episode) for episode in self._episodes])
        return [not part.any() for part in np.split(repeated, ends[:-1])]

    def _compared(self, other: _Recorded, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which steps are simultaneous with one of another, and which are the same.

        Parameters
        ----------
        other : _Recorded
        step : float
            Time between two steps, in nanoseconds.

        Returns
        -------
        at_same_time, same : numpy.ndarray of bool, shape (steps,)

        """
        times = other._stamps[other._order]
        after = np.searchsorted(times, self._stamps)
        at_same_time = np.zeros(len(self._stamps), bool)
        same = np.zeros(len(self._stamps), bool)
        for place in (after - 1, after):
            neighbour = np.clip(place, 0, len(times) - 1)
            is_near = abs(times[neighbour] - self._stamps) < step
            at_same_time |= is_near
            values = other._states[other._order[neighbour]]
            same |= is_near & (values == self._states).all(axis=1)
        return at_same_time, same


def _content(episode: Episode) -> tuple[bytes, ...]:
    return tuple(a.tobytes() for a in (episode.states, episode.rewards, episode.actions))
