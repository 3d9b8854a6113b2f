"""The selectors: scikit-learn's manners around a search by one of two criteria."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .conditional_mi import ConditionalMI
from .episode import Episode, as_episodes, unique_episodes
from .evidence import ConditionalTest, Evidence
from .kdr import KDR
from .lsmi import Lsmi
from .permutation import PermutationTest, permutation_test
from .samples import Samples, collect_samples, split_by_step
from .search import (
    DIRECTIONS,
    Criterion,
    Sensor,
    backward_elimination,
    channels,
    forward_selection,
)
from .stepwise import Finding, StepwiseSelection

#: Statuses of a sensor.
CONFIRMED, TENTATIVE, REJECTED = 'confirmed', 'tentative', 'rejected'
#: Kernel widths of the default; the paper's grid is wider and finer, with the same results.
_WIDTHS = tuple(np.logspace(-1, 1.5, 6))
#: A bin holds no more samples: neighbouring steps of an episode tell nearly the same.
_MAX_SAMPLES = 1000
#: How much greater the score must be for steps to be pooled that could be told apart.
_POOLING_FACTOR, _POOLING_MARGIN = 1.5, 0.1
#: Sensors added for comparing time bins.
_NUM_TRIED = 2
#: p-value at which the return is taken to change with the age of the episode.
_DRIFT_LEVEL = 0.01


class Ranking(NamedTuple):
    """Sensors in their order; the first `num_selected` are selected.

    Attributes
    ----------
    sensors : list of int
    scores : list of float
    num_selected : int
    findings : list of Finding
        What speaks for each sensor; empty where the method tells nothing of that.

    """

    sensors: list[int]
    scores: list[float]
    num_selected: int
    findings: list[Finding]


class SensorSelector(ABC):
    """What the selectors share: everything but the criterion.

    Attributes
    ----------
    ranking_ : numpy.ndarray of int
        Indices of all sensors that were ranked, best first; without groups, of channels.
    scores_ : numpy.ndarray, same length
        The criterion of the first 1, 2, ... sensors of the ranking; no sensor at all scores 0.
        That of a sensor that was not taken is with all that were.
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
    def _rank(
        self, episodes: list[Episode], names: tuple[str, ...], sensors: list[Sensor]
    ) -> Ranking:
        """Rank the sensors; raise ValueError for a bad parameter."""

    def fit(
        self,
        episodes,
        names: Sequence[str] | None = None,
        *,
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> SensorSelector:
        """Rank the sensors and select the best.

        Parameters
        ----------
        episodes : iterable of Episode, or a pair of arrays of shapes (M, N, v) and (M, N)
            At least 2 episodes.
        names : sequence of str, optional
            One name for each channel; x0, x1, ... by default.
        progress : callable
            Told, as sensors are found, a fraction that grows towards 1: how many there will be
            is not known.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described; the message names the value.

        """
        self._progress = progress
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

        ranking = self._rank(episodes, names, sensors)
        self.feature_names_in_ = names
        self.sensor_names_ = sensor_names
        self.ranking_ = np.array(ranking.sensors, dtype=int)
        self.scores_ = np.array(ranking.scores)
        self.num_features_ = ranking.num_selected
        self.findings_ = ranking.findings
        self._support = np.array(
            channels(sensors, ranking.sensors[: ranking.num_selected]), dtype=int
        )
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

    def fit_transform(self, episodes, names: Sequence[str] | None = None):
        """Fit, and return the selected channels of each episode's states."""
        episodes = as_episodes(episodes)
        self.fit(episodes, names)
        return [self.transform(episode.states) for episode in episodes]

    def inverse_transform(self, selected: np.ndarray) -> np.ndarray:
        """Return states (..., v) of selected channels (..., k), 0 where nothing was selected."""
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
        """Return the parameters of the constructor by name, as scikit-learn wants them."""
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}

    def set_params(self, **params) -> SensorSelector:
        """Set parameters of the constructor by name.

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
        """Return the call that makes it, without what is left at its default."""
        signature = inspect.signature(type(self)).parameters
        shown = (
            f'{name}={value!r}'
            for name, value in self.get_params().items()
            if value is not signature[name].default and value != signature[name].default
        )
        return f'{type(self).__name__}({", ".join(shown)})'

    def _checked(self, episodes, names):
        """Return the episodes, the names of channels and of sensors, and the sensors."""
        episodes = as_episodes(episodes)
        if len(episodes) < 2:
            raise ValueError('there is 1 episode; expected at least 2 to compare')
        names = _checked_names(names, episodes[0].num_channels)
        return episodes, names, *_sensors(names, self.groups or {})

    def _rank_by_score(self, criterion: Criterion, sensors: list[Sensor]) -> Ranking:
        """Rank by the criterion alone; without a number all are selected."""
        count = len(sensors) if self.num_features is None else self.num_features
        if self.direction == 'forward':
            return Ranking(*forward_selection(criterion, sensors, count), count, [])
        return Ranking(*backward_elimination(criterion, sensors), count, [])

    def _check_fitted(self):
        if not hasattr(self, 'ranking_'):
            raise RuntimeError('the selector is not fitted yet; call fit() first')


class ConditionalMISelector(SensorSelector):
    """Select the sensors that the return depends on, also through several time steps.

    The score proposes the next sensor, and a test disposes: is the score higher than with shadows
    of that sensor, given those selected before? In the end each is tested given all the others.
    Its further attributes are those of `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        How many sensors to select. None takes those that are confirmed, which may be none.
    gamma : float
        Discount factor of the return, 0 < gamma <= 1.
    criterion : {'held_out', 'plug_in'}
        See `Lsmi`. 'plug_in' ranks by the score alone, and selects all where no number is given.
    standardize : bool
        Draw in far values and scale channels and returns over all samples.
    direction : {'forward', 'backward'}
        Forward selection, or backward elimination, whose first sensors are then tested.
    groups : mapping of str to sequence of (str or int), optional
        Sensors that deliver several channels: name to channel names or indices. A channel in
        no group is a sensor by itself. Sensors are selected whole; in forward selection the
        channel of it that tells most speaks for it.
    max_time_bins : int or 'auto', optional
        Longer episodes have neighbouring steps pooled into this many bins; None never pools.
        'auto' decides by the score between 32 and a single one.
    tuning_window : int
        How many steps (or bins) on either side help a step to pick its kernel width and
        regularisation; see `ConditionalMI`.
    num_centers : int, optional
        Greatest number of kernel centres in a step; None takes all samples.
    significance : float
        Probability, 0 < significance < 1, that anything is confirmed where nothing matters.
    random_state : int
        Seed. The same seed and data give the same result bit for bit on one machine.
    n_jobs : int
        Threads that share the work.

    Attributes
    ----------
    pvalues_ : numpy.ndarray, shape (len(ranking_),)
        Of the hypothesis that a sensor tells nothing beside those selected, corrected for the
        number of candidates.
    statuses_ : list of str
        'confirmed', 'tentative' or 'rejected', for each sensor of the ranking.
    findings_ : list of Finding
        The evidence itself: scores of shadows, and the channels that spoke.
    num_duplicates_ : int
        Episodes that were there twice, states and rewards alike, and left out.

    Notes
    -----
    What is confirmed tells something about the return of the policy that collected the episodes.
    What tells nothing under that policy may matter under another. Where the return drifts from
    episode to episode, every sensor is judged given the episode's age.

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
        max_time_bins: int | str | None = 'auto',
        tuning_window: int = 2,
        num_centers: int | None = 50,
        significance: float = 0.05,
        random_state: int = 0,
        n_jobs: int = 1,
    ):
        super().__init__(num_features, direction, groups, random_state)
        self.gamma = gamma
        self.criterion = criterion
        self.standardize = standardize
        self.max_time_bins = max_time_bins
        self.tuning_window = tuning_window
        self.num_centers = num_centers
        self.significance = significance
        self.n_jobs = n_jobs

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

    @property
    def pvalues_(self) -> np.ndarray:
        """Corrected p-values; see the class."""
        return np.array([finding.evidence.pvalue for finding in self.findings_])

    @property
    def statuses_(self) -> list[str]:
        """Status of each sensor; see the class."""
        return [
            CONFIRMED
            if finding.evidence.pvalue <= self.significance
            else (REJECTED if finding.evidence.pvalue >= 1 else TENTATIVE)
            for finding in self.findings_
        ]

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
        self._check_parameters()
        bins = 32 if self.max_time_bins == 'auto' else self.max_time_bins
        return permutation_test(
            lambda data: self._criterion(self._samples(data), bins),
            episodes,
            sensors,
            n_permutations,
            self.random_state,
        )

    def _rank(self, episodes, names, sensors):
        self._check_parameters()
        num_episodes = len(episodes)
        episodes = unique_episodes(episodes)
        self.num_duplicates_ = num_episodes - len(episodes)
        if len(episodes) < 2:
            raise ValueError(
                f'all {num_episodes} episodes are alike; expected at least 2 to compare'
            )
        samples = self._samples(episodes)
        if self.criterion == 'plug_in':
            return self._rank_by_score(self._criterion(samples, self._fixed_bins()), sensors)
        varying = np.ptp(samples.states, axis=0) > 0
        live = [i for i, sensor in enumerate(sensors) if varying[list(sensor)].any()]
        living = [tuple(c for c in sensors[i] if varying[c]) for i in live]
        bins = self._choose_bins(samples, living)
        if self.direction == 'backward':
            chosen = self._backward(samples, bins, living)
        age = samples.owner / (samples.owner[-1] + 1)
        samples = samples.with_channels((age - age.mean())[:, None] / max(age.std(), 1e-9))
        test = ConditionalTest(samples, lambda s: self._criterion(s, bins), self.random_state)
        last = samples.states.shape[1] - 1
        drifts = test((last,), ()).pvalue <= _DRIFT_LEVEL
        search = StepwiseSelection(
            self._criterion(samples, bins),
            test,
            living,
            significance=self.significance,
            background=[last] if drifts else [],
            progress=self._progress,
        )
        found = search.confirmed() if self.direction == 'forward' else search.tested(chosen)
        if self.num_features is None:
            others = search.listed(found)
            num_selected = len(found)
        else:
            found = found[: self.num_features]
            others = search.ranked(found, self.num_features - len(found))
            num_selected = self.num_features
        criterion = self._criterion(samples, bins)
        taken = [f.channels for f in found]
        scores = [*self._path(criterion, taken), *(f.evidence.score for f in others)]
        findings = [f._replace(sensor=live[f.sensor]) for f in (*found, *others)]
        dead = [i for i in range(len(sensors)) if i not in live]
        score = scores[len(found) - 1] if found else 0.0
        nothing = Evidence(score, (score, score, score), 1.0)
        if self.num_features is None:
            findings += [Finding(i, sensors[i], nothing) for i in dead]
            scores += [score] * len(dead)
        elif len(findings) < num_selected:
            raise ValueError(
                f'num_features is {num_selected}, but only {len(findings)} sensors ever change: '
                f'constant are {", ".join(names[sensors[i][0]] for i in dead)}'
            )
        return Ranking([f.sensor for f in findings], scores, num_selected, findings)

    def _backward(self, samples, bins, sensors):
        """Return what backward elimination leaves where the score is greatest."""
        ranking, scores = backward_elimination(self._criterion(samples, bins), sensors)
        return ranking[: int(np.argmax(scores)) + 1]

    def _choose_bins(self, samples, sensors):
        """Return the number of time bins by which the score is greater."""
        if self.max_time_bins != 'auto':
            return self.max_time_bins
        units = [(channel,) for sensor in sensors for channel in sensor]
        tried = min(_NUM_TRIED, len(units))
        best = {
            bins: max(forward_selection(self._criterion(samples, bins), units, tried)[1], default=0)
            for bins in (1, 32)
        }
        pools = best[1] > _POOLING_FACTOR * max(best[32], 0.0) + _POOLING_MARGIN
        return 1 if pools else 32

    def _fixed_bins(self):
        return 32 if self.max_time_bins == 'auto' else self.max_time_bins

    def _path(self, criterion, taken):
        return [
            float(criterion([[c for unit in taken[: i + 1] for c in unit]])[0])
            for i in range(len(taken))
        ]

    def _check_parameters(self):
        bins = self.max_time_bins
        if bins is not None and bins != 'auto' and (isinstance(bins, str) or bins < 1):
            raise ValueError(
                f"max_time_bins is {bins!r}; expected at least 1, None for no bins, or 'auto'"
            )
        if self.tuning_window < 0:
            raise ValueError(f'tuning_window is {self.tuning_window}; expected at least 0')
        if not 0 < self.significance < 1:
            raise ValueError(f'significance is {self.significance}; expected 0 < significance < 1')
        if self.n_jobs < 1:
            raise ValueError(f'n_jobs is {self.n_jobs}; expected at least 1')

    def _samples(self, episodes) -> Samples:
        return collect_samples(episodes, gamma=self.gamma, standardize=self.standardize)

    def _criterion(self, samples: Samples, bins: int | None) -> ConditionalMI:
        is_default = self.criterion == 'held_out'
        estimator = Lsmi(
            criterion=self.criterion,
            num_centers=self.num_centers,
            **({'widths': _WIDTHS} if is_default else {}),
        )
        steps = split_by_step(
            samples,
            max_time_bins=bins,
            num_folds=estimator.num_folds,
            num_centers=self.num_centers,
            random_state=self.random_state,
            max_samples=_MAX_SAMPLES if is_default else None,
        )
        return ConditionalMI(steps, estimator, tuning_window=self.tuning_window, n_jobs=self.n_jobs)


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

    def _rank(self, episodes, names, sensors):
        target = [self.target] if isinstance(self.target, str | int) else self.target
        if len(target) == 0:
            raise ValueError(f'target is {self.target!r}; expected at least one channel')
        indices = [_channel_index(names, channel, 'target') for channel in target]
        criterion = KDR(episodes, indices, random_state=self.random_state)
        return self._rank_by_score(criterion, sensors)


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
