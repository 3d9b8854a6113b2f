"""One episode of experience: what the robot saw and what it was paid."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Episode:
    """States and rewards of one episode, checked and read-only.

    Parameters
    ----------
    states : array_like, shape (T, v)
        The v channel values before each of the T steps.
    rewards : array_like, shape (T,)
        ``rewards[t]`` is the reward of the step taken from ``states[t]``.
    actions : array_like, shape (T, a), optional
        ``actions[t]`` is the action taken at ``states[t]``; one column where the shape is (T,).
    source : str
        The robot or the recording it is from, where there are several: each may have its own mean.

    Raises
    ------
    ValueError
        If a shape is wrong, the episode is empty, or a value is not finite.

    """

    states: np.ndarray
    rewards: np.ndarray
    actions: np.ndarray | None = None
    source: str = ''

    def __post_init__(self):
        states = np.array(self.states, dtype=np.float64)
        rewards = np.array(self.rewards, dtype=np.float64)
        actions = np.array(np.empty((len(rewards), 0)) if self.actions is None else self.actions)
        actions = actions.astype(np.float64)
        if actions.ndim == 1:
            actions = actions[:, None]
        if states.ndim != 2 or 0 in states.shape:
            raise ValueError(
                f'states has shape {states.shape}; expected (steps, channels), neither of them 0'
            )
        if rewards.shape != states.shape[:1]:
            raise ValueError(
                f'rewards has shape {rewards.shape}; expected {states.shape[:1]}, '
                'one reward for each state'
            )
        if actions.ndim != 2 or len(actions) != len(states):
            raise ValueError(
                f'actions has shape {actions.shape}; expected ({len(states)}, values), '
                'one action for each state'
            )
        arrays = {'states': states, 'rewards': rewards, 'actions': actions}
        for what, values in arrays.items():
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                where = tuple(int(i) for i in bad[0])
                raise ValueError(
                    f'{what}[{", ".join(map(str, where))}] is {values[where]}; '
                    'expected finite numbers'
                )
        for name, values in arrays.items():
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        """Return the number of steps T."""
        return len(self.rewards)

    @property
    def num_channels(self) -> int:
        """Number of channels v of the state."""
        return self.states.shape[1]

    @property
    def nbytes(self) -> int:
        """Memory held by the arrays, in bytes."""
        return self.states.nbytes + self.rewards.nbytes + self.actions.nbytes


def as_episodes(data: Iterable[Episode] | tuple[np.ndarray, np.ndarray]) -> list[Episode]:
    """Return a list of episodes with the same channels.

    Parameters
    ----------
    data : iterable of Episode, or a pair of arrays of shapes (M, N, v) and (M, N)
        The pair holds the states and the rewards of M episodes of N steps. What is NaN or masked
        in the states is a gap, bridged by the last reading before it in its episode, else by the
        next, else by the channel's median; an infinite one stands for out of range (REP 117) and
        becomes the channel's greatest or least finite reading.

    Raises
    ------
    ValueError
        If there is no episode, or the episodes differ in their number of channels.

    """
    if isinstance(data, tuple) and len(data) == 2 and not isinstance(data[0], Episode):
        states, rewards = (np.ma.filled(np.ma.asarray(part, dtype=float), np.nan) for part in data)
        if states.ndim != 3 or rewards.shape != states.shape[:2]:
            raise ValueError(
                f'the pair of arrays has shapes {states.shape} and {rewards.shape}; '
                'expected (episodes, steps, channels) and (episodes, steps)'
            )
        states = _bridged(states)
        episodes = [Episode(s, r) for s, r in zip(states, rewards, strict=True)]
    else:
        episodes = list(data)
        for i, episode in enumerate(episodes):
            if not isinstance(episode, Episode):
                raise ValueError(f'episode {i} is a {type(episode).__name__}; expected an Episode')
    if not episodes:
        raise ValueError('there are 0 episodes; expected at least one')
    for i, episode in enumerate(episodes):
        if episode.num_channels != episodes[0].num_channels:
            raise ValueError(
                f'episode {i} has {episode.num_channels} channels; '
                f'expected {episodes[0].num_channels} as in episode 0'
            )
    return episodes


def unique_episodes(episodes: Iterable[Episode]) -> list[Episode]:
    """Return the episodes without those that repeat an earlier one, states and rewards alike."""
    seen, unique = set(), []
    for episode in episodes:
        content = tuple(a.tobytes() for a in (episode.states, episode.rewards, episode.actions))
        if content not in seen:
            seen.add(content)
            unique.append(episode)
    return unique


def _bridged(states: np.ndarray) -> np.ndarray:
    """Return states (M, N, v) without gaps and infinite values; `as_episodes` tells how."""
    if np.isfinite(states).all():
        return states
    finite = np.where(np.isfinite(states), states, np.nan)
    empty = np.isnan(finite).all(axis=(0, 1))
    if empty.any():
        raise ValueError(
            f'channel {int(np.flatnonzero(empty)[0])} has no finite value; expected some readings'
        )
    filled = np.where(states == np.inf, np.nanmax(finite, axis=(0, 1)), states)
    filled = np.where(states == -np.inf, np.nanmin(finite, axis=(0, 1)), filled)
    for step in range(1, states.shape[1]):
        gap = np.isnan(filled[:, step])
        filled[:, step][gap] = filled[:, step - 1][gap]
    for step in range(states.shape[1] - 2, -1, -1):
        gap = np.isnan(filled[:, step])
        filled[:, step][gap] = filled[:, step + 1][gap]
    return np.where(np.isnan(filled), np.nanmedian(finite, axis=(0, 1)), filled)
