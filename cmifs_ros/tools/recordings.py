# SPDX-License-Identifier: Apache-2.0

"""Recordings that stay where they were read, here or on a cluster, and answer questions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from cmifs_ros.collect.outline import Outline, outline_of
from cmifs_ros.collect.pooling import Pool, Share, episodes_of_share
from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.thinning import Plan, ThinnedEpisodes, joined, thinned

from .bags import with_progress
from .cluster import backend, connected

#: Reads a recording; may take `watch`, see `episodes_of_recording`.
Reader = Callable[..., RecordedEpisodes]


class Recordings(ABC):
    """Recordings, each of which is read once."""

    @abstractmethod
    def read(self, paths: Sequence[Path], read: Reader) -> Iterator[Outline | RecordingError]:
        """Read recordings, and give the outline of each, or why it cannot be read.

        Those that cannot be read do not count among the recordings.
        """

    @abstractmethod
    def ask(
        self,
        function: Callable[..., Any],
        which: Sequence[int],
        *arguments: Iterable,
    ) -> list:
        """Return what a function answers of some of the recordings that were read.

        Parameters
        ----------
        function : callable
            Takes a `RecordedEpisodes`, and an element of each of the arguments.
        which : sequence of int
            Indices of the recordings that were read.
        *arguments : iterable
            One element for each recording.

        """

    def thinned(self, pool: Pool, selector: ConditionalMISelector) -> ThinnedEpisodes:
        """Return the episodes of a pool of these recordings as far as a selector looks at them."""
        plans = selector.plan(pool.lengths).split([len(share.which) for share in pool.shares])
        of_share = partial(_thinned, gamma=selector.gamma)
        return joined(self.ask(of_share, [s.recording for s in pool.shares], pool.shares, plans))

    def episodes(self, pool: Pool) -> list[Episode]:
        """Return the episodes of a pool of these recordings, from wherever they are."""
        numbers = [share.recording for share in pool.shares]
        return [e for part in self.ask(episodes_of_share, numbers, pool.shares) for e in part]


@contextmanager
def recordings_at(scheduler: str | None, jobs: int) -> Iterator[Recordings]:
    """Give recordings on the cluster of a Dask scheduler, or here.

    Parameters
    ----------
    scheduler : str or None
        Its address; None: here.
    jobs : int
        Number of recordings that are read in parallel here.

    Raises
    ------
    CommandError
        If the cluster is unusable or breaks down.

    """
    if scheduler is None:
        yield _Here(jobs)
    else:
        with connected(scheduler) as client:
            yield _OnCluster(client)


class _Here(Recordings):
    def __init__(self, jobs: int):
        self._jobs = jobs
        self._recordings: list[RecordedEpisodes] = []

    def read(self, paths, read):
        for recording in self._found(paths, read):
            outline = _outline(recording)
            if isinstance(outline, Outline):
                self._recordings.append(recording)
            yield outline

    def _found(self, paths, read):
        from joblib import Parallel, delayed
        from tqdm import tqdm

        if self._jobs == 1 or len(paths) == 1:
            yield from (_tried(path, partial(read, watch=with_progress)) for path in paths)
            return
        with backend(None):
            found = Parallel(self._jobs, return_as='generator')(
                delayed(_tried)(path.absolute(), read) for path in paths
            )
            yield from tqdm(found, total=len(paths), unit=' recordings', disable=None, leave=False)

    def ask(self, function, which, *arguments):
        return list(map(function, [self._recordings[i] for i in which], *arguments))


class _OnCluster(Recordings):
    """Futures of recordings; a cluster that loses one reads it again."""

    def __init__(self, client):
        self._client = client
        self._recordings: list = []

    def read(self, paths, read):
        from distributed import KilledWorker
        from tqdm import tqdm

        absolute = [path.absolute() for path in paths]
        found = self._client.map(partial(_tried, read=read), absolute, pure=False)
        outlines = self._client.map(_outline, found, pure=False)
        shown = tqdm(outlines, unit=' recordings', disable=None, leave=False)
        for path, recording, future in zip(paths, found, shown, strict=True):
            try:
                outline = future.result()
            except KilledWorker:
                outline = RecordingError(f'{path}: each worker that read it died; is it too large?')
            if isinstance(outline, Outline):
                self._recordings.append(recording)
            yield outline

    def ask(self, function, which, *arguments):
        recordings = [self._recordings[i] for i in which]
        return self._client.gather(self._client.map(function, recordings, *arguments, pure=False))


def _tried(path: Path, read: Reader) -> RecordedEpisodes | RecordingError:
    try:
        return read(path)
    except RecordingError as error:
        return error
    except OSError as error:
        return RecordingError(f'{path} cannot be read: {error}')


def _outline(recording: RecordedEpisodes | RecordingError) -> Outline | RecordingError:
    return recording if isinstance(recording, RecordingError) else outline_of(recording)


def _thinned(
    recording: RecordedEpisodes, share: Share, plan: Plan, *, gamma: float
) -> ThinnedEpisodes:
    return thinned(episodes_of_share(recording, share), gamma, plan)
