# SPDX-License-Identifier: Apache-2.0

"""One episode: the states of the robot and the rewards it received."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from .words import counted


@dataclass(frozen=True, eq=False)
class Episode:
    """States and rewards of one episode, validated and read-only.

    Parameters
    ----------
    states : array_like, shape (T, v)
        The v channel values before each of the T steps.
    rewards : array_like, shape (T,), or None
        ``rewards[t]`` is the reward of the step taken from ``states[t]``; None, as for a
        demonstration without rewards, sets all to 0.
    actions : array_like, shape (T, a), optional
        ``actions[t]`` is the action taken at ``states[t]``; shape (T,) is one column.
    source : str, optional
        The robot or recording, if there are several: each may have its own mean. What is no text
        is turned into one; None is no source.

    Raises
    ------
    ValueError
        If a shape is wrong, the episode is empty, or a value is not finite.

    """

    states: np.ndarray
    rewards: np.ndarray
    actions: np.ndarray = field(default=None)
    source: str = ''

    def __post_init__(self):
        states = np.array(self.states, dtype=np.float64)
        rewards = np.zeros(states.shape[:1]) if self.rewards is None else self.rewards
        rewards = np.array(rewards, dtype=np.float64)
        actions = np.empty((len(states), 0)) if self.actions is None else self.actions
        actions = np.array(actions, dtype=np.float64)
        if actions.ndim == 1:
            actions = actions[:, None]
        if states.ndim != 2 or 0 in states.shape:
            raise ValueError(
                f'states has shape {states.shape}; expected (steps, channels), both at least 1'
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
        object.__setattr__(self, 'source', '' if self.source is None else str(self.source))

    def __repr__(self) -> str:
        """Return the shapes, not the numbers: a list of episodes fits a screen."""
        source = f', source={self.source!r}' if self.source else ''
        return (
            f'Episode({counted(len(self), "step")}, {counted(self.num_channels, "channel")}, '
            f'{counted(self.actions.shape[1], "action value")}{source})'
        )

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


def as_episodes(data: Iterable[Episode] | tuple[np.ndarray, ...]) -> list[Episode]:
    """Return a list of episodes with the same channels and actions.

    Parameters
    ----------
    data : iterable of Episode, or arrays of shapes (M, N, v), (M, N) and, optionally, (M, N, a)
        States, rewards and actions of M episodes of N steps. NaN and masked states are gaps. A gap
        is filled with the previous value in its episode, or the next one, or the channel's median.
        Infinite values mean out of range (REP 117); they become the channel's greatest or least
        finite value.

    Raises
    ------
    ValueError
        If there is no episode, the episodes differ in their number of channels, or a channel has
        no finite value.

    """
    if isinstance(data, tuple) and len(data) in (2, 3) and not isinstance(data[0], Episode):
        parts = [np.ma.filled(np.ma.asarray(part, dtype=float), np.nan) for part in data]
        states, shape = parts[0], parts[0].shape[:2]
        if states.ndim != 3 or parts[1].shape != shape or parts[-1].shape[:2] != shape:
            raise ValueError(
                f'the arrays have shapes {", ".join(str(part.shape) for part in parts)}; expected '
                '(episodes, steps, channels), (episodes, steps) and, if there are actions, '
                '(episodes, steps, actions)'
            )
        episodes = [Episode(*of_one) for of_one in zip(_bridged(states), *parts[1:], strict=True)]
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
        if episode.actions.shape[1] != episodes[0].actions.shape[1]:
            raise ValueError(
                f'episode {i} has actions of {episode.actions.shape[1]} values; '
                f'expected {episodes[0].actions.shape[1]} as in episode 0'
            )
    return episodes


def _bridged(states: np.ndarray) -> np.ndarray:
    """Return states (M, N, v) without gaps and infinite values, as `as_episodes` describes."""
    if np.isfinite(states).all():
        return states
    finite = np.where(np.isfinite(states), states, np.nan)
    empty = np.isnan(finite).all(axis=(0, 1))
    if empty.any():
        raise ValueError(
            f'channel {int(np.flatnonzero(empty)[0])} has no finite value; expected at least one'
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
