"""The newest episodes, bounded in number."""

from __future__ import annotations

from collections import deque

from .episode import Episode


class EpisodeBuffer:
    """Keep the newest `max_episodes` episodes; an older one leaves when a new one comes.

    Parameters
    ----------
    max_episodes : int
        Greatest number of episodes held, at least 1.

    Raises
    ------
    ValueError
        If `max_episodes` is below 1.

    """

    def __init__(self, max_episodes: int = 100):
        self._episodes: deque[Episode] = deque(maxlen=_checked(max_episodes))

    def __len__(self) -> int:
        """Return the number of episodes held."""
        return len(self._episodes)

    @property
    def max_episodes(self) -> int:
        """Greatest number of episodes held; the oldest leave when it is lowered."""
        return self._episodes.maxlen

    @max_episodes.setter
    def max_episodes(self, value: int) -> None:
        self._episodes = deque(self._episodes, maxlen=_checked(value))

    @property
    def num_steps(self) -> int:
        """Number of steps held, summed over the episodes."""
        return sum(map(len, self._episodes))

    @property
    def nbytes(self) -> int:
        """Memory held by the episodes' arrays, in bytes."""
        return sum(episode.nbytes for episode in self._episodes)

    def append(self, episode: Episode) -> None:
        """Add one episode.

        Raises
        ------
        ValueError
            If its number of channels differs from that of the episodes held.

        """
        if self._episodes and episode.num_channels != self._episodes[0].num_channels:
            raise ValueError(
                f'the episode has {episode.num_channels} channels; '
                f'expected {self._episodes[0].num_channels} as in the episodes held'
            )
        self._episodes.append(episode)

    def clear(self) -> None:
        """Forget all episodes."""
        self._episodes.clear()

    def snapshot(self) -> tuple[Episode, ...]:
        """Return the episodes held now, oldest first; later changes do not touch it."""
        return tuple(self._episodes)


def _checked(max_episodes: int) -> int:
    if max_episodes < 1:
        raise ValueError(f'max_episodes is {max_episodes}; expected at least 1')
    return int(max_episodes)
