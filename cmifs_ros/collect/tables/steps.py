# SPDX-License-Identifier: Apache-2.0

"""Episodes of recordings in which each row is a step, as in data sets for robot learning.

Numbers under a key of their own, such as the position of the gripper, are one sensor. If the state
is a single vector, each of its numbers is a sensor, named by the recording if possible.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core import Episode
from cmifs_ros.core.channel_names import problem_of_names
from cmifs_ros.core.words import counted, first, listed

#: The key of a single vector that is the whole state or action.
WHOLE = ''
#: A whole number with at most this many values is a discrete action.
_MOST_CHOICES = 32


@dataclass(frozen=True)
class Steps:
    """The steps of an episode as read.

    Attributes
    ----------
    name : str
        Name of the episode, for messages.
    states, actions : dict of str to numpy.ndarray, shape (T,) or (T, n)
        The parts of a state or an action by key.
    rewards : numpy.ndarray, shape (T,), or None
    pictures : dict of str to callable
        By key of a camera, what returns a small grey picture at a step.
    source : str
        The robot or recording, if the recording names several.

    """

    name: str
    states: Mapping[str, np.ndarray]
    actions: Mapping[str, np.ndarray]
    rewards: np.ndarray | None
    pictures: Mapping[str, Callable[[int], np.ndarray]] = field(default_factory=dict)
    source: str = ''

    def __len__(self) -> int:
        """Return the number of steps T."""
        return len(next(iter(self.states.values())))


@dataclass(frozen=True)
class Names:
    """The names of a recording's numbers.

    Attributes
    ----------
    state : str
        Name, with an index, for unnamed numbers of a single state vector.
    of_states, of_actions : mapping of str to sequence of str
        Names of the numbers by key, if given; an index such as `[0,1]` is a name, too.

    """

    state: str
    of_states: Mapping[str, Sequence[str]] = field(default_factory=dict)
    of_actions: Mapping[str, Sequence[str]] = field(default_factory=dict)


def episodes_of_steps(
    path,
    found: Iterable[Steps],
    names: Names,
    no_rewards: str,
    dropped: Mapping[str, int],
    *,
    remedy: str = '',
    **about,
) -> RecordedEpisodes:
    """Return the episodes of a recording.

    An infinite value of a sensor is out of range (REP 117): it becomes the greatest or the least
    value of its channel in the recording. An episode with another number that is not finite is
    dropped, and counted by where it occurs.

    Parameters
    ----------
    path : object
        The recording, for messages.
    found : iterable of Steps
    names : Names
    no_rewards : str
        Why there are no rewards, if there are none.
    dropped : mapping of str to int
        Earlier drops by cause.
    remedy : str
        What helps if a sensor has no value, to be appended to the cause.
    **about
        Further fields of `RecordedEpisodes`.

    Raises
    ------
    RecordingError
        If there is no episode, or episodes differ in their keys or shapes.

    """
    parts = list(found)
    if not parts:
        raise RecordingError(f'{path} has no complete episode')
    parts, choices = _one_hot(parts)
    names = replace(names, of_actions={**names.of_actions, **choices})
    if len({part.rewards is None for part in parts}) > 1:
        raise RecordingError(f'{path} has rewards in some episodes only; expected them in all')
    states, channels = _within_range(_stacked(path, parts, 'states')), []
    for key, size in _sizes(parts[0].states).items():
        channels += _channel_names(key, size, names)
    actions, action_names = _stacked(path, parts, 'actions'), []
    for key, size in _sizes(parts[0].actions).items():
        action_names += _action_names(key, size, names)
    problem = problem_of_names([*channels, *action_names])
    if problem:
        raise RecordingError(f'{path} has {problem}')
    episodes, counts = [], Counter[str](dropped)
    pictures: dict[str, list[Callable[[int], np.ndarray]]] = {key: [] for key in parts[0].pictures}
    for part, state, action in zip(parts, states, actions, strict=True):
        missing = _not_finite(state, channels)
        helps = remedy if missing else ''
        missing += _not_finite(action, action_names)
        if part.rewards is not None:
            missing += _not_finite(part.rewards[:, None], ['the reward'])
        if missing:
            counts[f'episodes in which {listed(missing)} is not a finite number{helps}'] += 1
        else:
            episodes.append(Episode(state, part.rewards, action, part.source))
            for key, of_episode in part.pictures.items():
                pictures[key].append(of_episode)
    return RecordedEpisodes(
        tuple(channels), episodes, sum(map(len, states)), tuple(action_names), dropped=counts,
        unit='step', no_rewards='' if parts[0].rewards is not None else no_rewards,
        cameras={key: partial(_pictures, of_key) for key, of_key in pictures.items()}, **about,
    )  # fmt: skip


def _pictures(
    of_episodes: Sequence[Callable[[int], np.ndarray]], steps: Sequence[tuple[int, int]]
) -> list[np.ndarray]:
    return [of_episodes[episode](step) for episode, step in steps]


def _sizes(values: Mapping[str, np.ndarray]) -> dict[str, int]:
    return {key: 1 if of_key.ndim == 1 else of_key.shape[1] for key, of_key in values.items()}


def _stacked(path, parts: Sequence[Steps], what: str) -> list[np.ndarray]:
    """Return the states or actions of each episode as one array, shape (T, n)."""
    expected = _sizes(getattr(parts[0], what))
    stacked = []
    for part in parts:
        values = getattr(part, what)
        if _sizes(values) != expected:
            raise RecordingError(
                f'{path}: {part.name} has {what} of {_shown(_sizes(values))}; expected '
                f'{_shown(expected)}, as {parts[0].name} has'
            )
        columns = [np.asarray(values[key], float) for key in expected]
        stacked.append(np.column_stack(columns) if columns else np.empty((len(part), 0)))
    return stacked


def _within_range(states: list[np.ndarray]) -> list[np.ndarray]:
    """Return the states with the greatest and least finite value of a channel for infinite ones."""
    if not any(np.isinf(of_episode).any() for of_episode in states):
        return states
    together = np.concatenate(states)
    is_finite = np.isfinite(together)
    greatest = together.max(axis=0, where=is_finite, initial=-np.inf)
    least = together.min(axis=0, where=is_finite, initial=np.inf)
    return [np.clip(of_episode, least, greatest) for of_episode in states]


def _shown(sizes: Mapping[str, int]) -> str:
    return first([f'{key} {counted(n, "number")}'.strip() for key, n in sizes.items()]) or 'none'


def _channel_names(key: str, size: int, names: Names) -> list[str]:
    given = names.of_states.get(key, ())
    if len(given) == size:
        return [name if key == WHOLE else _member(key, name) for name in given]
    if key == WHOLE:
        return [f'{names.state}_{i}' for i in range(size)]
    return [key] if size == 1 else [f'{key}[{i}]' for i in range(size)]


def _member(key: str, name: str) -> str:
    return key + name if name.startswith('[') else f'{key}.{name}'


def _action_names(key: str, size: int, names: Names) -> list[str]:
    """Return names like those of `cmifs_ros.sim.gymnasium_episodes.action_names`."""
    given, base = names.of_actions.get(key, ()), f'action_{key}' if key else 'action'
    if len(given) == size:
        return [f'{base}.{name}' for name in given]
    return [base] if size == 1 else [f'{base}_{i}' for i in range(size)]


def _not_finite(values: np.ndarray, names: Sequence[str]) -> list[str]:
    return [names[i] for i in np.flatnonzero(~np.isfinite(values).all(axis=0))]


def _one_hot(parts: list[Steps]) -> tuple[list[Steps], dict[str, list[str]]]:
    """Return steps with one-hot discrete actions, and their values."""
    choices: dict[str, list[str]] = {}
    for key in parts[0].actions:
        found = [part.actions.get(key, np.empty(0)) for part in parts]
        if not all(one.dtype.kind in 'iu' and one.size == len(one) for one in found):
            continue
        values = np.unique(np.concatenate([one.ravel() for one in found]))
        if 2 <= len(values) <= _MOST_CHOICES:
            choices[key] = [str(value) for value in values]
            parts = [
                replace(part, actions={**part.actions, key: one.reshape(-1, 1) == values})
                for part, one in zip(parts, found, strict=True)
            ]
    return parts, choices
