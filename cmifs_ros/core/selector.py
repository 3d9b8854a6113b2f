"""The selectors: scikit-learn's manners around a search by one of two criteria."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from .conditional_mi import ConditionalMI
from .episode import Episode, as_episodes
from .kdr import KDR
from .lsmi import Lsmi
from .permutation import PermutationTest, num_beyond_shadows, permutation_test
from .search import (
    DIRECTIONS,
    Criterion,
    Sensor,
    backward_elimination,
    channels,
    forward_selection,
)


class SensorSelector(ABC):
    """What the selectors share: everything but the criterion.

    Attributes
    ----------
    ranking_ : numpy.ndarray of int
        Indices of all sensors that were ranked, best first; without groups, of channels.
    scores_ : numpy.ndarray, same length
        The criterion of the first 1, 2, ... sensors of the ranking; no sensor at all scores 0.
    sensor_names_ : tuple of str
        Names of the sensors that `ranking_` counts.
    num_features_ : int
        Number of sensors selected: the first of the ranking.
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
    def _make_criterion(self, episodes: list[Episode], names: tuple[str, ...]) -> Criterion:
        """Return the criterion of these episodes; raise ValueError for a bad parameter."""

    @abstractmethod
    def _choose_number(
        self, episodes: list[Episode], names: tuple[str, ...], ranked: list[Sensor]
    ) -> int:
        """Return how many of the ranked sensors to select when the caller does not say."""

    def fit(self, episodes, names: Sequence[str] | None = None) -> SensorSelector:
        """Rank the sensors and select the best.

        Parameters
        ----------
        episodes : iterable of Episode, or a pair of arrays of shapes (M, N, v) and (M, N)
            At least 2 episodes.
        names : sequence of str, optional
            One name for each channel; x0, x1, ... by default.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described; the message names the value.

        """
        episodes, names, sensor_names, sensors = self._checked(episodes, names)
        if self.num_features is not None and not 1 <= self.num_features <= len(sensors):
            raise ValueError(
                f'num_features is {self.num_features}; expected 1 to {len(sensors)}, '
                'the number of sensors, or None'
            )
        if self.direction not in DIRECTIONS:
            raise ValueError(
                f'direction is {self.direction!r}; expected one of {", ".join(DIRECTIONS)}'
            )

        criterion = self._make_criterion(episodes, names)
        if self.direction == 'forward':
            count = len(sensors) if self.num_features is None else self.num_features
            ranking, scores = forward_selection(criterion, sensors, count)
        else:
            ranking, scores = backward_elimination(criterion, sensors)

        self.feature_names_in_ = names
        self.sensor_names_ = sensor_names
        self.ranking_ = np.array(ranking)
        self.scores_ = np.array(scores)
        if self.num_features is None:
            ranked = [sensors[i] for i in ranking]
            self.num_features_ = self._choose_number(episodes, names, ranked)
        else:
            self.num_features_ = self.num_features
        self._support = np.array(channels(sensors, ranking[: self.num_features_]), dtype=int)
        return self

    def get_support(self, indices: bool = False) -> np.ndarray:
        """Return the selected channels.

        Parameters
        ----------
        indices : bool
            True gives their indices, best sensor first; False a mask of shape (v,).

        """
        self._check_fitted()
        if indices:
            return self._support.copy()
        mask = np.zeros(len(self.feature_names_in_), dtype=bool)
        mask[self._support] = True
        return mask

    def transform(self, states: np.ndarray) -> np.ndarray:
        """Return the selected channels of states (..., v), best sensor first: (..., k)."""
        self._check_fitted()
        states = np.asarray(states)
        if states.ndim == 0 or states.shape[-1] != len(self.feature_names_in_):
            raise ValueError(
                f'states has shape {states.shape}; expected '
                f'{len(self.feature_names_in_)} channels along the last axis'
            )
        return states[..., self._support]

    def get_feature_names_out(self) -> np.ndarray:
        """Return the names of the channels that `transform` gives, in its order."""
        self._check_fitted()
        return np.array([self.feature_names_in_[i] for i in self._support], dtype=object)

    def _checked(self, episodes, names):
        """Return the episodes, the names of channels and of sensors, and the sensors."""
        episodes = as_episodes(episodes)
        if len(episodes) < 2:
            raise ValueError('there is 1 episode; expected at least 2 to compare')
        names = _checked_names(names, episodes[0].num_channels)
        return episodes, names, *_sensors(names, self.groups or {})

    def _check_fitted(self):
        if not hasattr(self, 'ranking_'):
            raise RuntimeError('the selector is not fitted yet; call fit() first')


class ConditionalMISelector(SensorSelector):
    """Select the sensors that the return depends on, also through several time steps.

    Its attributes are those of `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        How many sensors to select. None ranks all and takes the first ones, up to the first that
        does no better than shadows: sensors that deliver what they delivered in other episodes.
        `permutation.num_beyond_shadows` has the rule. Where the return depends on nothing, that
        is none at all in 95 % of cases. It takes about as long as ranking them.
    gamma : float
        Discount factor of the return, 0 < gamma <= 1.
    criterion : {'held_out', 'plug_in'}
        See `Lsmi`.
    standardize : bool
        Scale channels and returns over all samples.
    direction : {'forward', 'backward'}
        Forward selection, or backward elimination (which always ranks every sensor).
    groups : mapping of str to sequence of (str or int), optional
        Sensors that deliver several channels: name to channel names or indices. A channel in
        no group is a sensor by itself. Sensors are added and removed whole.
    max_time_bins : int, optional
        Longer episodes have neighbouring steps pooled into this many bins; None never pools.
    tuning_window : int
        How many steps (or bins) on either side help a step to pick its kernel width and
        regularisation; see `ConditionalMI`.
    num_centers : int, optional
        Greatest number of kernel centres in a step; None takes all samples.
    random_state : int
        Seed. The same seed and data give the same result bit for bit on one machine.
    executor : concurrent.futures.Executor, optional
        Shares the work among its processes: a `concurrent.futures.ProcessPoolExecutor`, or one of
        another library. Each should keep the linear algebra library to one thread
        (OPENBLAS_NUM_THREADS=1 in the environment). None computes in this thread.

    Notes
    -----
    What decides on the number compares with sensors that are independent of everything. One that
    repeats what was selected before it differs from them, and may be kept; it ranks late, so
    that a smaller `num_features` leaves it out. A sensor that tells something only together with
    another is tested when the ranking has come to it, with those before it, not after it.

    Hachiya & Sugiyama, Feature Selection for Reinforcement Learning: Evaluating Implicit
    State-Reward Dependency via Conditional Mutual Information, 2010.

    """

    def __init__(
        self,
        num_features: int | None = None,
        *,
        gamma: float = 0.95,
        criterion: str = 'held_out',
        standardize: bool = True,
        direction: str = 'forward',
        groups: Mapping[str, Sequence[str | int]] | None = None,
        max_time_bins: int | None = 32,
        tuning_window: int = 2,
        num_centers: int | None = 200,
        random_state: int = 0,
        executor: Executor | None = None,
    ):
        super().__init__(num_features, direction, groups, random_state)
        self.gamma = gamma
        self.criterion = criterion
        self.standardize = standardize
        self.max_time_bins = max_time_bins
        self.tuning_window = tuning_window
        self.num_centers = num_centers
        self.executor = executor

    @classmethod
    def paper(cls, num_features: int | None = None, **options) -> ConditionalMISelector:
        """Return a selector set as in the paper: raw features, Equation (10), B = M, all steps."""
        paper = {
            'criterion': 'plug_in',
            'standardize': False,
            'max_time_bins': None,
            'tuning_window': 0,
            'num_centers': None,
        }
        return cls(num_features, **(paper | options))

    def permutation_test(
        self, episodes, names: Sequence[str] | None = None, *, n_permutations: int = 99
    ) -> PermutationTest:
        """Test whether the return depends on any single sensor.

        The statistic is the score of the best sensor, the first of a forward selection. All
        trajectories of states change places between the episodes, as wholes and all channels
        together; the rewards stay. If the return is independent of the states, all of that is
        equally likely, and the p-value is uniform on 1/(n + 1), 2/(n + 1), ..., 1. With
        unequal lengths, which `permutation.exchange` copes with, that holds if the length is
        independent of the states too. The selector need not be fitted, and stays as it is.

        Parameters
        ----------
        episodes, names
            As of `fit`.
        n_permutations : int
            Each costs one round of the search; the p-value is at least 1 / (n_permutations + 1).

        Returns
        -------
        PermutationTest
            `statistic`, `pvalue`, `null_distribution`.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described; the message names the value.

        """
        episodes, names, _, sensors = self._checked(episodes, names)
        if n_permutations < 1:
            raise ValueError(f'n_permutations is {n_permutations}; expected at least 1')
        return permutation_test(
            lambda data: self._make_criterion(data, names),
            episodes,
            sensors,
            n_permutations,
            self.random_state,
        )

    def _make_criterion(self, episodes: list[Episode], names: tuple[str, ...]) -> ConditionalMI:
        if self.max_time_bins is not None and self.max_time_bins < 1:
            raise ValueError(f'max_time_bins is {self.max_time_bins}; expected at least 1, or None')
        if self.tuning_window < 0:
            raise ValueError(f'tuning_window is {self.tuning_window}; expected at least 0')
        return ConditionalMI(
            episodes,
            Lsmi(criterion=self.criterion, num_centers=self.num_centers),
            gamma=self.gamma,
            standardize=self.standardize,
            max_time_bins=self.max_time_bins,
            tuning_window=self.tuning_window,
            random_state=self.random_state,
            executor=self.executor,
        )

    def _choose_number(self, episodes, names, ranked):
        return num_beyond_shadows(
            lambda data: self._make_criterion(data, names), episodes, ranked, self.random_state
        )


class KDRSelector(SensorSelector):
    """Select the sensors that the target channels depend on one step later.

    The method that Hachiya & Sugiyama (2010) compare theirs with; see `KDR`. It does not look
    at the rewards: it is told the channels that they depend on directly. Its attributes are
    those of `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        How many sensors to select. None ranks and selects all: one more sensor explains the
        target better, or seems to, so the criterion has no maximum to stop at.
    target : str, int, or sequence of these
        The channels that the reward depends on directly: names or indices.
    direction, groups
        As of `ConditionalMISelector`.
    random_state : int
        Seed of the samples that the kernel width is computed from, where there are very many.

    """

    def __init__(
        self,
        num_features: int | None = None,
        *,
        target: str | int | Sequence[str | int],
        direction: str = 'forward',
        groups: Mapping[str, Sequence[str | int]] | None = None,
        random_state: int = 0,
    ):
        super().__init__(num_features, direction, groups, random_state)
        self.target = target

    def _make_criterion(self, episodes: list[Episode], names: tuple[str, ...]) -> KDR:
        target = [self.target] if isinstance(self.target, str | int) else self.target
        if len(target) == 0:
            raise ValueError(f'target is {self.target!r}; expected at least one channel')
        indices = [_channel_index(names, channel, 'target') for channel in target]
        return KDR(episodes, indices, random_state=self.random_state)

    def _choose_number(self, episodes, names, ranked):
        return len(ranked)


def _checked_names(names: Sequence[str] | None, num_channels: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f'x{i}' for i in range(num_channels))
    names = tuple(names)
    if len(names) != num_channels:
        raise ValueError(f'there are {len(names)} names; expected {num_channels}, one a channel')
    for name in names:
        if not name or names.count(name) > 1:
            raise ValueError(f'channel name {name!r} is empty or repeated; expected distinct names')
    return names


def _channel_index(names: tuple[str, ...], channel: str | int, where: str) -> int:
    index = names.index(channel) if channel in names else channel
    if not isinstance(index, int) or not 0 <= index < len(names):
        raise ValueError(f'{where} names channel {channel!r}; expected one of {", ".join(names)}')
    return index


def _sensors(
    names: tuple[str, ...], groups: Mapping[str, Sequence[str | int]]
) -> tuple[tuple[str, ...], list[Sensor]]:
    """Return the names and the channels of all sensors, in the order of their first channels."""
    grouped: dict[int, str] = {}
    sensors: dict[str, Sensor] = {}
    for group, members in groups.items():
        indices = []
        for member in members:
            index = _channel_index(names, member, f'group {group!r}')
            if index in grouped:
                raise ValueError(
                    f'channel {names[index]!r} is in the groups {grouped[index]!r} and {group!r}; '
                    'expected one group'
                )
            grouped[index] = group
            indices.append(index)
        if not indices:
            raise ValueError(f'group {group!r} is empty; expected at least one channel')
        sensors[group] = tuple(indices)
    for index, name in enumerate(names):
        if index not in grouped:
            if name in sensors:
                raise ValueError(f'{name!r} names a group and a channel outside it; rename one')
            sensors[name] = (index,)
    ordered = sorted(sensors.items(), key=lambda item: min(item[1]))
    return tuple(name for name, _ in ordered), [channels_ for _, channels_ in ordered]
