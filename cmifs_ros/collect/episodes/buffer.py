# SPDX-License-Identifier: Apache-2.0

"""A buffer of the newest episodes, bounded in number and memory."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable

from cmifs_ros.core import Episode
from cmifs_ros.core.fingerprints import fingerprint
from cmifs_ros.core.words import counted


class EpisodeBuffer:
    """Keep the newest episodes; the oldest are removed to make room for a new one.

    An exact copy of an episode (same states, rewards and actions), as from a bag played in a loop,
    is no further evidence: it is counted but not kept.

    Parameters
    ----------
    max_episodes : int
        Greatest number of episodes held, at least 1.
    max_bytes : int, optional
        Greatest size of their arrays, at least 1; None: unlimited.

    Attributes
    ----------
    num_repeated : int
        Number of copies that were not kept.
    renewals : float
        How much has come in since the buffer was cleared, or old ones forgotten: each doubling of
        the number held counts 1, and so does a complete replacement.
    num_clears : int
        How often it was cleared.

    Raises
    ------
    ValueError
        If a bound is below 1.

    """

    def __init__(self, max_episodes: int = 100, max_bytes: int | None = None):
        self._episodes: OrderedDict[bytes, Episode] = OrderedDict()  # by fingerprint
        self.num_repeated = self.num_clears = 0
        self.renewals = 0.0
        self._num_steps = 0
        self._nbytes = 0
        self._max_episodes = _checked('max_episodes', max_episodes)
        self.max_bytes = max_bytes

    def __len__(self) -> int:
        """Return the number of episodes held."""
        return len(self._episodes)

    @property
    def max_episodes(self) -> int:
        """Greatest number of episodes held; lowering it removes the oldest."""
        return self._max_episodes

    @max_episodes.setter
    def max_episodes(self, value: int) -> None:
        self._max_episodes = _checked('max_episodes', value)
        self._make_room(0, 0)

    @property
    def max_bytes(self) -> int | None:
        """Greatest size of the episodes' arrays in bytes; lowering it removes the oldest."""
        return self._max_bytes

    @max_bytes.setter
    def max_bytes(self, value: int | None) -> None:
        self._max_bytes = None if value is None else _checked('max_bytes', value)
        self._make_room(0, 0)

    @property
    def num_steps(self) -> int:
        """Number of steps held, summed over the episodes."""
        return self._num_steps

    @property
    def nbytes(self) -> int:
        """Memory held by the episodes' arrays, in bytes."""
        return self._nbytes

    def append(self, episode: Episode) -> bool:
        """Add one episode; return False if it is a copy of one held.

        Raises
        ------
        ValueError
            If its number of channels differs from that of the episodes held, or if it exceeds
            `max_bytes`.

        """
        held = next(iter(self._episodes.values()), episode)
        if episode.num_channels != held.num_channels:
            raise ValueError(
                f'the episode has {counted(episode.num_channels, "channel")}; '
                f'expected {held.num_channels} as in the episodes held'
            )
        if self.max_bytes is not None and episode.nbytes > self.max_bytes:
            raise ValueError(
                f'the episode has {episode.nbytes} bytes; expected at most {self.max_bytes}'
            )
        found = fingerprint(episode)
        if found in self._episodes:
            self.num_repeated += 1
            return False
        if not self._make_room(1, episode.nbytes) and self._episodes:
            self.renewals += math.log2(1 + 1 / len(self))
        self._episodes[found] = episode
        self._num_steps += len(episode)
        self._nbytes += episode.nbytes
        return True

    def forget(self, episodes: Iterable[Episode]) -> None:
        """Remove some episodes; those no longer held are ignored."""
        for episode in episodes:
            held = self._episodes.pop(fingerprint(episode), None)
            if held is not None:
                self._count_out(held)
        self.renewals = math.log2(max(len(self), 1))

    def clear(self) -> None:
        """Remove all episodes."""
        self._episodes.clear()
        self._num_steps = self._nbytes = 0
        self.renewals = 0.0
        self.num_clears += 1

    def snapshot(self) -> tuple[Episode, ...]:
        """Return the episodes held now, oldest first; later changes do not affect the result."""
        return tuple(self._episodes.values())

    def _make_room(self, num_episodes: int, nbytes: int) -> bool:
        """Remove the oldest until there is room; return whether any was removed."""
        num_before = len(self)
        while self._episodes and (
            len(self._episodes) + num_episodes > self.max_episodes
            or (self.max_bytes is not None and self._nbytes + nbytes > self.max_bytes)
        ):
            _, oldest = self._episodes.popitem(last=False)
            self._count_out(oldest)
        num_removed = num_before - len(self)
        self.renewals += num_removed / max(num_before, 1)
        return num_removed > 0

    def _count_out(self, episode: Episode) -> None:
        self._num_steps -= len(episode)
        self._nbytes -= episode.nbytes


def _checked(name: str, value: int) -> int:
    if value < 1:
        raise ValueError(f'{name} is {value}; expected at least 1')
    return int(value)
