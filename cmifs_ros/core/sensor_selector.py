# SPDX-License-Identifier: Apache-2.0

"""The base class of the selectors: scikit-learn-style API and validation."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from numbers import Integral
from typing import NamedTuple

import numpy as np

from .episode import Episode, as_episodes
from .search import (
    DIRECTIONS,
    Criterion,
    Sensor,
    backward_elimination,
    channels,
    forward_selection,
)
from .sensors import checked_names, sensors_of
from .words import listed


class Ranking(NamedTuple):
    """Ranked sensors with their scores; the first `num_selected` are selected."""

    sensors: list[int]
    scores: list[float]
    num_selected: int


class SensorSelector(ABC):
    """Base class of the selectors: everything except the criterion.

    Attributes
    ----------
    ranking_ : numpy.ndarray of int
        Indices of the ranked sensors, best first; without groups, a sensor is a channel.
    scores_ : numpy.ndarray, same length
        The criterion of the first 1, 2, ... sensors together. For a sensor without evidence, if the
        method has a test: of this sensor together with all that have. No sensor at all scores 0.
    sensor_names_ : tuple of str
        Names of the sensors that `ranking_` indexes.
    sensor_channels_ : tuple of tuple of int
        Their channels.
    num_features_ : int
        Number of selected sensors; they are the first of the ranking.
    n_features_in_ : int
        Number of channels.
    feature_names_in_ : tuple of str
        Names of the channels.

    """

    def __init__(
        self,
        num_features: int | None,
        direction: str,
        groups: Mapping[str, Sequence[str | int]] | None,
        random_state: int,
    ):
        self.num_features = num_features
        self.direction = direction
        self.groups = groups
        self.random_state = random_state

    @abstractmethod
    def _rank(
        self, episodes: list[Episode], names: Sequence[str], sensors: list[Sensor]
    ) -> Ranking:
        """Rank the sensors; raise ValueError for an invalid parameter."""

    def fit(
        self,
        episodes,
        names: Sequence[str] | None = None,
        *,
        start: Collection[str] = (),
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> SensorSelector:
        """Rank the sensors and select the best.

        Parameters
        ----------
        episodes : iterable of Episode, or a pair of arrays of shapes (M, N, v) and (M, N)
            At least 2 episodes.
        names : sequence of str, optional
            One name for each channel; x0, x1, ... by default.
        start : collection of str
            Sensors of an earlier selection. If the method has a test, the search begins with them,
            and they stay selected unless they are dispensable. So of two equivalent sensors the
            one in use stays, and none is dropped for lack of evidence alone.
        progress : callable
            Called with a fraction that grows towards 1 as sensors are found; their number is
            unknown in advance.

        Raises
        ------
        ValueError
            If a parameter or the data are invalid; the message names the value.

        """
        episodes, names, sensor_names, sensors = self._checked(episodes, names)
        self._start = [i for i, name in enumerate(sensor_names) if name in start]
        wanted = self.num_features
        if wanted is not None and not (
            isinstance(wanted, Integral) and 1 <= wanted <= len(sensors)
        ):
            raise ValueError(
                f'num_features is {wanted!r}; expected 1 to {len(sensors)}, '
                'the number of sensors, or None'
            )
        if self.direction not in DIRECTIONS:
            raise ValueError(
                f'direction is {self.direction!r}; expected one of {", ".join(DIRECTIONS)}'
            )

        self._progress = progress
        try:
            ranking = self._rank(episodes, names, sensors)
        finally:
            del self._progress  # A callable that may not be picklable.
        self.feature_names_in_ = names
        self.n_features_in_ = len(names)
        self.sensor_names_ = sensor_names
        self.sensor_channels_ = tuple(sensors)
        self.ranking_ = np.array(ranking.sensors, dtype=int)
        self.scores_ = np.array(ranking.scores)
        self.num_features_ = ranking.num_selected
        self._support = np.array(
            channels(sensors, ranking.sensors[: ranking.num_selected]), dtype=int
        )
        return self

    def get_support(self, indices: bool = False) -> np.ndarray:
        """Return the selected channels.

        Parameters
        ----------
        indices : bool
            True: return their indices, best sensor first. False: return a mask of shape (v,).

        """
        self._check_fitted()
        if indices:
            return self._support.copy()
        mask = np.zeros(len(self.feature_names_in_), dtype=bool)
        mask[self._support] = True
        return mask

    def transform(self, states: np.ndarray) -> np.ndarray:
        """Return the selected channels of states (..., v), best sensor first: shape (..., k).

        Of a data frame with columns named as in `fit`, whatever their order: these columns.

        Raises
        ------
        ValueError
            If the number of channels is not that of `fit`, or a data frame lacks one.

        """
        self._check_fitted()
        columns = [name for name in getattr(states, 'columns', ()) if isinstance(name, str)]
        if not set(self.feature_names_in_).isdisjoint(columns):
            names = [self.feature_names_in_[i] for i in self._support]
            lacking = [name for name in names if name not in columns]
            if lacking:
                raise ValueError(
                    f'states has no column {listed(lacking)}; expected the names given to fit: '
                    f'{listed(self.feature_names_in_)}'
                )
            return np.asarray(states[names])
        states = np.asarray(states)
        if states.ndim == 0 or states.shape[-1] != len(self.feature_names_in_):
            raise ValueError(
                f'states has shape {states.shape}; expected '
                f'{len(self.feature_names_in_)} channels along the last axis'
            )
        return states[..., self._support]

    def get_feature_names_out(self, input_features: Sequence[str] | None = None) -> np.ndarray:
        """Return the names of the channels that `transform` returns, in the same order.

        Parameters
        ----------
        input_features : sequence of str, optional
            The names given to `fit`, as scikit-learn passes them.

        Raises
        ------
        ValueError
            If these differ from the names given to `fit`.

        """
        self._check_fitted()
        if input_features is not None and tuple(input_features) != self.feature_names_in_:
            raise ValueError(
                f'input_features is {listed(list(input_features))}; expected the names given to '
                f'fit: {listed(self.feature_names_in_)}'
            )
        return np.array([self.feature_names_in_[i] for i in self._support], dtype=object)

    def fit_transform(self, episodes, names: Sequence[str] | None = None):
        """Fit, and return the selected channels of each episode's states."""
        episodes = as_episodes(episodes)
        self.fit(episodes, names)
        return [self.transform(episode.states) for episode in episodes]

    def inverse_transform(self, selected: np.ndarray) -> np.ndarray:
        """Return states (..., v) from selected channels (..., k); other channels are 0."""
        self._check_fitted()
        selected = np.asarray(selected)
        if selected.ndim == 0 or selected.shape[-1] != len(self._support):
            raise ValueError(
                f'selected has shape {selected.shape}; expected '
                f'{len(self._support)} channels along the last axis'
            )
        states = np.zeros((*selected.shape[:-1], len(self.feature_names_in_)))
        states[..., self._support] = selected
        return states

    def get_params(self, deep: bool = True) -> dict:
        """Return the constructor parameters by name, as scikit-learn requires."""
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}

    def set_params(self, **params) -> SensorSelector:
        """Set constructor parameters by name.

        Raises
        ------
        ValueError
            If there is no such parameter.

        """
        known = self.get_params()
        for name, value in params.items():
            if name not in known:
                raise ValueError(f'there is no parameter {name!r}; expected {", ".join(known)}')
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        """Return the constructor call, without parameters at their default."""
        signature = inspect.signature(type(self)).parameters
        shown = (
            f'{name}={value!r}'
            for name, value in self.get_params().items()
            if value is not signature[name].default and value != signature[name].default
        )
        return f'{type(self).__name__}({", ".join(shown)})'

    def _checked(self, episodes, names):
        """Return the episodes, the channel names, the sensor names and the sensors."""
        episodes, num_channels = self._taken(episodes)
        if len(episodes) < 2:
            raise ValueError('there is 1 episode; expected at least 2 to compare')
        names = checked_names(names, num_channels)
        return episodes, names, *sensors_of(names, self.groups or {})

    def _taken(self, episodes):
        """Return the episodes and their number of channels."""
        episodes = as_episodes(episodes)
        return episodes, episodes[0].num_channels

    def _rank_by_score(self, criterion: Criterion, sensors: list[Sensor]) -> Ranking:
        """Rank by the criterion alone; without `num_features` all sensors are selected."""
        count = len(sensors) if self.num_features is None else self.num_features
        if self.direction == 'forward':
            return Ranking(*forward_selection(criterion, sensors, count), count)
        return Ranking(*backward_elimination(criterion, sensors), count)

    def _check_fitted(self):
        if not hasattr(self, 'ranking_'):
            raise RuntimeError('the selector is not fitted yet; call fit() first')
