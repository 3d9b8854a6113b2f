# SPDX-License-Identifier: Apache-2.0

"""Pool the episodes of several recordings in the order of time, without repetitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted, listed

from .episodes.same_actions import which_alike
from .outline import Outline, Trace
from .recorded_episodes import RecordedEpisodes, RecordingError

#: Two recordings are of the same run if at least this share of their simultaneous steps has equal
#: values. Not all have: two recorders may receive messages without a stamp in different order.
_SAME = 0.5
#: Two recordings overlap if at least this share of the steps of one is simultaneous with the
#: other's.
_OVERLAP = 0.05


@dataclass(frozen=True)
class Share:
    """What a recording gives to a pool.

    Attributes
    ----------
    recording : int
        Its index among those given.
    source : str
        The robot or recording that it belongs to.
    which : numpy.ndarray of int, shape (M,)
        The episodes that are used, at least one.
    with_actions : bool
        Whether their actions are used.

    """

    recording: int
    source: str
    which: np.ndarray
    with_actions: bool


@dataclass
class Pool:
    """Episodes of several recordings, which stay where they are.

    Attributes
    ----------
    channel_names : tuple of str
    shares : list of Share
        In the order of the recordings' time.
    lengths : numpy.ndarray of int, shape (M,)
        The number of steps of each episode.
    step_seconds : float
        Median time between steps; NaN if no episode has two.
    notes : list of str
        What was left out, and what looks wrong.
    action_names : tuple of str
        Names of the values of an action; empty if some episodes have no actions.

    """

    channel_names: tuple[str, ...] = ()
    shares: list[Share] = field(default_factory=list)
    lengths: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    step_seconds: float = float('nan')
    notes: list[str] = field(default_factory=list)
    action_names: tuple[str, ...] = ()

    @property
    def origins(self) -> list[tuple[int, int]]:
        """The recording of each episode, and its index there."""
        return [(share.recording, i) for share in self.shares for i in share.which.tolist()]


def episodes_of_share(recording: RecordedEpisodes, share: Share) -> list[Episode]:
    """Return the episodes that a recording gives to a pool, each with its source."""
    episodes = [recording.episodes[i] for i in share.which]
    without = {} if share.with_actions else {'actions': None}
    return [replace(e, source=share.source or e.source, **without) for e in episodes]


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


def pooled(
    recordings: Sequence[tuple[str, Outline]],
    trace: Callable[[int], Trace],
    by: str = 'none',
) -> Pool:
    """Return which episodes of several recordings to use.

    Each step counts once: if an earlier recording has one with the same time and values, as with a
    second recorder or a trimmed copy, the episode is left out; so is a copy of a whole episode,
    whenever it was recorded.

    Parameters
    ----------
    recordings : sequence of (str, Outline)
        Paths and outlines. Those without times come last, in the given order.
    trace : callable
        Returns the trace of a recording, given its index; only if it overlaps others in time.
    by : str
        What distinguishes the sources, see `source_of`.

    Raises
    ------
    RecordingError
        If the recordings differ in their channels or actions.

    """
    numbered = [(i, path, one) for i, (path, one) in enumerate(recordings) if len(one)]
    pool = Pool(step_seconds=_step_seconds([one for _, _, one in numbered]))
    used: list[_Used] = []  # those that may overlap the next ones
    known: set[bytes] = set()
    first = ''
    for number, path, one in sorted(numbered, key=lambda item: item[2].begin):
        facts = one.recording
        if facts.channel_names != (pool.channel_names or facts.channel_names):
            names = pool.channel_names, facts.channel_names
            raise RecordingError(f'{path} has other channels than {first}{_difference(*names)}')
        if pool.action_names and facts.action_names not in ((), pool.action_names):
            names = pool.action_names, facts.action_names
            raise RecordingError(f'{path} has other actions than {first}{_difference(*names)}')
        pool.channel_names = facts.channel_names
        pool.notes += [f'{path}: {note}' for note in facts.notes]
        step = pool.step_seconds * 1e9
        used = [other for other in used if not other.end + step < one.begin]
        this = _Used(path, source_of(path, by), number, one, trace)
        is_kept = this.not_in(used, step, pool.notes)
        places = {p: i for i, p in reversed(list(enumerate(one.prints)))}  # of the first of copies
        is_new = [p not in known and places[p] == i for i, p in enumerate(one.prints)]
        num_copies = sum(kept and not new for kept, new in zip(is_kept, is_new, strict=True))
        if not all(is_kept):
            pool.notes.append(_left_out(path, sum(not kept for kept in is_kept), len(one)))
        if num_copies:
            pool.notes.append(f'{_left_out(path, num_copies, len(one))}, with all their values')
        this.which = np.flatnonzero(np.array(is_kept) & np.array(is_new))
        if len(this.which):
            first = first or path
            known.update(one.prints[i] for i in this.which)
            used += [this] if np.isfinite(one.begin) else []
            pool.action_names = pool.action_names or facts.action_names
            pool.shares.append(Share(number, this.source, this.which, True))
    _reconcile(pool, [one for _, one in recordings])
    return pool


def _difference(expected: Sequence[str], found: Sequence[str]) -> str:
    """Return the end of an error: which names differ."""
    lacking = [name for name in expected if name not in found]
    more = [name for name in found if name not in expected]
    said = [f'it lacks {listed(lacking)}'] if lacking else []
    said += [f'it also has {listed(more)}'] if more else []
    return f'; expected the same: {" and ".join(said) or "their order differs"}'


def _left_out(path: str, count: int, total: int) -> str:
    return (
        f'{path}: {count} of {counted(total, "episode")} left out, because they were recorded twice'
    )


def _reconcile(pool: Pool, outlines: Sequence[Outline]) -> None:
    """Let all episodes have actions or none; set their lengths."""

    def together(of_outline: Callable[[Outline], np.ndarray]) -> np.ndarray:
        parts = [of_outline(outlines[share.recording])[share.which] for share in pool.shares]
        return np.concatenate([np.empty(0, int), *parts])

    which, with_actions, note = which_alike(together(lambda one: one.is_acting).astype(bool))
    pool.notes += [note] if note else []
    pool.lengths = together(lambda one: one.lengths)[which]
    ends = np.cumsum([0, *(len(share.which) for share in pool.shares)])
    pool.shares = [
        replace(share, which=share.which[which[a:b]], with_actions=with_actions)
        for share, (a, b) in zip(pool.shares, pairwise(ends), strict=True)
        if any(which[a:b])
    ]
    if not with_actions:
        pool.action_names = ()


def _step_seconds(outlines: Sequence[Outline]) -> float:
    """Return the median time between steps, where those of a recording have their median."""
    known = sorted((one.distance, one.num_distances) for one in outlines if one.num_distances)
    if not known:
        return float('nan')
    distances, counts = np.transpose(known)
    return float(distances[np.searchsorted(np.cumsum(counts), counts.sum() / 2)]) / 1e9


class _Used:
    """A recording and which of its episodes are used."""

    def __init__(
        self,
        path: str,
        source: str,
        number: int,
        outline: Outline,
        trace: Callable[[int], Trace],
    ):
        self.path, self.source, self.end = path, source, outline.end
        self.which = np.arange(len(outline))
        self._number, self._num_episodes = number, len(outline)
        self._has_times = np.isfinite(outline.begin)
        self._load = trace

    @cached_property
    def _trace(self) -> Trace:
        return self._load(self._number)

    @cached_property
    def _in_order(self) -> tuple[np.ndarray, np.ndarray]:
        """The stamps and fingerprints of the used episodes, in the order of time."""
        trace = self._trace
        rows = np.flatnonzero(np.isin(trace.owner, self.which))
        rows = rows[np.argsort(trace.stamps[rows], kind='stable')]
        return trace.stamps[rows], trace.prints[rows]

    def not_in(self, others: Sequence[_Used], step: float, notes: list[str]) -> np.ndarray:
        """Return which episodes are not in others; add notes about what looks wrong.

        Parameters
        ----------
        others : sequence of _Used
            Those that may overlap.
        step : float
            Time between two steps, in nanoseconds.
        notes : list of str

        """
        is_repeated = np.zeros(self._num_episodes, bool)
        for other in others if self._has_times else ():
            at_same_time, same = self._compared(other, step)
            if same.sum() >= _SAME * at_same_time.sum() > 0:
                is_repeated[self._trace.owner[same]] = True
                notes.append(
                    f'{self.path} repeats {counted(int(same.sum()), "step")} of {other.path}'
                )
            elif at_same_time.mean() > _OVERLAP and self.source == other.source:
                notes.append(
                    f'{self.path} and {other.path} overlap in time but differ in values; if they '
                    'are from two robots or two simulated runs, use --source bag'
                )
        return ~is_repeated

    def _compared(self, other: _Used, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which steps are simultaneous with one of another, and which are the same.

        Returns
        -------
        at_same_time, same : numpy.ndarray of bool, shape (steps,)

        """
        stamps, (times, prints) = self._trace.stamps, other._in_order
        after = np.searchsorted(times, stamps)
        at_same_time = np.zeros(len(stamps), bool)
        same = np.zeros(len(stamps), bool)
        for place in (after - 1, after):
            neighbour = np.clip(place, 0, len(times) - 1)
            is_near = abs(times[neighbour] - stamps) < step
            at_same_time |= is_near
            same |= is_near & (prints[neighbour] == self._trace.prints)
        return at_same_time, same
