# SPDX-License-Identifier: Apache-2.0

"""The selector of the project: of the sensors that have evidence, the one with the best score."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np

from .blas_threads import one_blas_thread
from .conditional_mi import ConditionalMI
from .data_checks import problem_of_skill, problems_of_data
from .effect import Effect
from .episode import unique_episodes
from .lsmi import Lsmi
from .permutation import PermutationTest, permutation_test
from .samples import Samples, collect_samples, normal_scores, split_by_step, standardized
from .search import Criterion, Sensor, backward_elimination
from .sensor_selector import Ranking, SensorSelector
from .shadows import null_scores
from .statuses import DISPENSABLE
from .stepwise import Finding, StepwiseSelection
from .targets import ACTION, RETURN, TARGETS, TargetTest
from .time_bins import MOST_BINS, choose_time_bins
from .verdicts import Verdict, verdicts

#: Kernel widths of the default; the paper's grid is wider and finer, with the same results.
WIDTHS = tuple(np.logspace(-1, 1.5, 6))
#: A bin holds no more samples: neighbouring steps of an episode tell nearly the same.
_MAX_SAMPLES = 1000
#: Episodes are shifted where signs give no more, so that no p-value depends on a smaller level.
_LEAST_SHIFTED = 0.05
#: Time bins are compared by so many channels, the likeliest to be informative.
_MAX_COMPARED = 10


class ConditionalMISelector(SensorSelector):
    """Select the sensors that the return, the action or a decision depends on.

    A test says which sensors are informative beside those selected before, and of these the one
    with the best score is next. In the end each is tested given all the others. Its further
    attributes are those of `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        How many sensors to select. None takes those that are confirmed, which may be none.
    target : {'return', 'decision', 'action'}
        What sensors are selected for; see `targets`. The score is that of the return, or of the
        action where there is no reward.
    gamma : float
        Discount factor of the return, 0 < gamma <= 1.
    criterion : {'held_out', 'plug_in'}
        See `Lsmi`. 'plug_in' ranks by the score alone, and selects all where no number is given.
    standardize : bool
        Take channels and returns by their normal scores over all samples.
    direction : {'forward', 'backward'}
        Forward selection, or backward elimination, whose first sensors are then tested.
    groups : mapping of str to sequence of (str or int), optional
        Sensors that deliver several channels: name to channel names or indices. A channel in
        no group is a sensor by itself. Sensors are selected whole; in forward selection those
        channels of it that tell something speak for it.
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
    margin : float
        A sensor that adds less than this share of the target's variance is dispensable.
    random_state : int
        Seed. The same seed and data give the same result bit for bit on one machine.
    n_jobs : int
        Threads that share the work.

    Attributes
    ----------
    pvalues_ : numpy.ndarray, shape (len(ranking_),)
        Of the hypothesis that a sensor is uninformative beside those selected, corrected for the
        number of candidates.
    statuses_ : list of str
        One of `STATUSES` for each sensor of the ranking.
    effects_ : list of Effect
        What each sensor adds to the prediction of the target beside the others selected.
    why_ : list of str
        The variable of the target for which the evidence for each sensor is strongest.
    predicted_share_, predicted_share_of_all_ : float
        Share of the target's variance that the selected sensors predict in episodes left out, and
        that all sensors do.
    warnings_ : list of str
        What limits what the data show. Each is also given to `warnings.warn`.
    null_scores_ : numpy.ndarray, shape (len(ranking_), 3)
        5 %, median and 95 % of the scores of uninformative sensors at the same place:
        a prediction from six, each with its trajectories exchanged between the episodes.
    supporting_channels_ : list of tuple of int
        The channels that support each sensor: all of it, or those of many that tell something,
        the best first; of one that never changed, none.
    redundant_with_ : list of tuple of int
        For each sensor of the ranking, the confirmed ones it is redundant with: without one of
        these there would be strong evidence for it, beside all of them it is not confirmed.
    num_duplicates_ : int
        Episodes that were there twice, states and rewards alike, and left out.

    Notes
    -----
    What is confirmed is informative under the policy that collected the episodes; what is not may
    matter under another.

    Hachiya & Sugiyama, Feature Selection for Reinforcement Learning: Evaluating Implicit
    State-Reward Dependency via Conditional Mutual Information, 2010.

    """

    def __init__(
        self,
        num_features: int | None = None,
        *,
        target: str = RETURN,
        gamma: float = 0.95,
        criterion: str = 'held_out',
        standardize: bool = True,
        direction: str = 'forward',
        groups: Mapping[str, Sequence[str | int]] | None = None,
        max_time_bins: int | str | None = 'auto',
        tuning_window: int = 2,
        num_centers: int | None = 50,
        significance: float = 0.05,
        margin: float = 0.02,
        random_state: int = 0,
        n_jobs: int = 1,
    ):
        super().__init__(num_features, direction, groups, random_state)
        self.target = target
        self.gamma = gamma
        self.criterion = criterion
        self.standardize = standardize
        self.max_time_bins = max_time_bins
        self.tuning_window = tuning_window
        self.num_centers = num_centers
        self.significance = significance
        self.margin = margin
        self.n_jobs = n_jobs

    @classmethod
    def paper(cls, num_features: int | None = None, **options) -> ConditionalMISelector:
        """Return a selector set as in the paper: raw features, Equation (10), B = M, all steps."""
        paper: dict[str, Any] = {
            'criterion': 'plug_in',
            'standardize': False,
            'max_time_bins': None,
            'tuning_window': 0,
            'num_centers': None,
        }
        return cls(num_features, **(paper | options))

    def single_scores(self, episodes, names: Sequence[str] | None = None) -> np.ndarray:
        """Return the criterion of each sensor by itself: shape (S,). Nothing is fitted.

        Parameters
        ----------
        episodes, names
            As of `fit`.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described; the message names the value.

        """
        episodes, names, _, sensors = self._checked(episodes, names)
        self._check_parameters()
        with one_blas_thread():
            return self._criterion(self._samples(episodes), self._bins)(sensors)

    def permutation_test(
        self, episodes, names: Sequence[str] | None = None, *, n_permutations: int = 99
    ) -> PermutationTest:
        """Test whether the return depends on any sensor; see `permutation.permutation_test`."""
        return permutation_test(self, episodes, names, n_permutations=n_permutations)

    @property
    def _bins(self) -> int | None:
        """The number of time bins where the data do not choose it."""
        return MOST_BINS if isinstance(self.max_time_bins, str) else self.max_time_bins

    def fit(
        self,
        episodes,
        names: Sequence[str] | None = None,
        *,
        action_names: Sequence[str] | None = None,
        ordered: bool = True,
        start: Collection[str] = (),
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> ConditionalMISelector:
        """Rank the sensors and select the best; see `SensorSelector.fit`.

        Parameters
        ----------
        episodes, names, start, progress
            As of `SensorSelector.fit`; arrays may have a third one of actions, (M, N, a).
        action_names : sequence of str, optional
            One name for each value of the actions; action0, action1, ... by default.
        ordered : bool
            Whether the order of the episodes is that of time. Then slow drift, which any two
            slow things share, is no evidence. Say False where it means nothing.

        """
        self._ordered, self._action_names = ordered, action_names
        try:
            super().fit(episodes, names, start=start, progress=progress)
        finally:
            del self._ordered, self._action_names
        return self

    def _rank(self, episodes, names, sensors):
        self._check_parameters()
        with one_blas_thread():
            return self._ranked(episodes, names, sensors)

    def _ranked(self, episodes, names, sensors):
        self.warnings_: list[str] = []
        self.predicted_share_ = self.predicted_share_of_all_ = 0.0
        num_episodes = len(episodes)
        episodes = unique_episodes(episodes)
        self.num_duplicates_ = num_episodes - len(episodes)
        if len(episodes) < 2:
            raise ValueError(
                f'all {num_episodes} episodes are alike; expected at least 2 to compare'
            )
        samples = self._samples(episodes)
        if self.criterion == 'plug_in':
            self._keep_evidence([], [], np.empty((0, 3)))
            return self._rank_by_score(self._criterion(samples, self._bins), sensors)
        self._warn_of(problems_of_data(episodes, self.gamma, ordered=self._ordered))
        varying = np.ptp(samples.states, axis=0) > 0
        live = [i for i, sensor in enumerate(sensors) if varying[list(sensor)].any()]
        dead = [i for i in range(len(sensors)) if i not in live]
        if self.num_features is not None and self.num_features > len(live):
            raise ValueError(
                f'num_features is {self.num_features}, but only {len(live)} sensors ever change: '
                f'constant are {", ".join(names[sensors[i][0]] for i in dead)}'
            )
        living = [tuple(c for c in sensors[i] if varying[c]) for i in live]
        start = [i for i, sensor in enumerate(live) if sensor in self._start]
        findings: list[Finding] = []
        found: list[Verdict] = []
        null, num_selected = np.empty((0, 3)), 0
        if living:
            test = self._test(samples, names)
            while True:
                findings, null, num_selected = self._search(samples, test, living, start)
                found = verdicts(
                    test,
                    living,
                    findings,
                    num_selected,
                    confirmed_before=start,
                    significance=self.significance,
                    margin=self.margin,
                )
                dispensable = [
                    finding.sensor
                    for finding, verdict in zip(findings[:num_selected], found, strict=False)
                    if finding.sensor in start and verdict.status == DISPENSABLE
                ]
                if not dispensable:
                    break
                start = [sensor for sensor in start if sensor not in dispensable]
            selected = [c for f in findings[:num_selected] for c in f.channels]
            self.predicted_share_ = test.predicted_share(selected)
            self.predicted_share_of_all_ = test.predicted_share([c for s in living for c in s])
        findings = [
            f._replace(
                sensor=live[f.sensor], redundant_with=tuple(live[i] for i in f.redundant_with)
            )
            for f in findings
        ]
        if self.num_features is None and dead:
            score = findings[num_selected - 1].score if num_selected else 0.0
            findings += [Finding(i, (), score) for i in dead]
            found += [Verdict(DISPENSABLE, Effect(0.0, 0.0), '')] * len(dead)
            null = np.vstack([null, np.full((len(dead), 3), score)])
        self._keep_evidence(findings, found, null)
        return Ranking([f.sensor for f in findings], [f.score for f in findings], num_selected)

    def _test(self, samples: Samples, names: Sequence[str]) -> TargetTest:
        num_actions = samples.actions.shape[1]
        action_names = self._action_names or [f'action{i}' for i in range(num_actions)]
        if len(action_names) != num_actions:
            raise ValueError(
                f'there are {len(action_names)} action_names; expected {num_actions}, '
                'one for each value of an action'
            )
        if self.target == ACTION and not num_actions:
            raise ValueError("target is 'action', but the episodes have no actions")
        test = TargetTest(
            samples,
            self.target,
            names,
            action_names,
            self.gamma,
            random_state=self.random_state,
            level=max(self.significance, _LEAST_SHIFTED),
            ordered=self._ordered,
            n_jobs=self.n_jobs,
        )
        if num_actions and self.target == RETURN:
            acting = TargetTest(samples, ACTION, names, action_names, self.gamma)
            self._warn_of([problem_of_skill(acting.predicted_share, samples.states.shape[1])])
        return test

    def _search(self, samples: Samples, test, living: list[Sensor], start: list[int]):
        """Return the findings, the scores of uninformative sensors, and how many are selected."""
        units = [(channel,) for sensor in living for channel in sensor]
        likely = np.argsort(test(units, []), kind='stable')[:_MAX_COMPARED]
        bins, criterion = self._choose_bins(samples, [units[i] for i in likely])
        search = StepwiseSelection(
            criterion,
            test,
            living,
            significance=self.significance,
            progress=self._progress,
        )
        if self.direction == 'forward':
            confirmed = search.confirmed(start)
        else:
            confirmed = search.tested(self._backward(criterion, living))
        if self.num_features is None:
            num_selected, found = len(confirmed), confirmed
            others = search.listed(found)
            before = [found[:i] for i in range(num_selected)] + [found] * len(others)
        else:
            num_selected = self.num_features
            found = confirmed[:num_selected]
            others = search.ranked(found, num_selected - len(found))
            before = [[*found, *others][:i] for i in range(num_selected)]
        null = null_scores(
            lambda extended: self._criterion(extended, bins),
            samples,
            [channel for sensor in living for channel in sensor],
            [[c for f in rest for c in f.channels] for rest in before],
            np.random.default_rng([self.random_state, 3]),
        )
        return [*found, *search.with_redundant(confirmed, others)], null, num_selected

    def _warn_of(self, problems: Sequence[str]) -> None:
        for problem in filter(None, problems):
            self.warnings_.append(problem)
            warnings.warn(problem, stacklevel=7)

    def _keep_evidence(
        self, findings: list[Finding], found: Sequence[Verdict], null: np.ndarray
    ) -> None:
        self.pvalues_ = np.array([finding.pvalue for finding in findings])
        self.statuses_ = [verdict.status for verdict in found]
        self.effects_ = [verdict.effect for verdict in found]
        self.why_ = [verdict.why for verdict in found]
        self.null_scores_ = null
        self.supporting_channels_ = [finding.channels for finding in findings]
        self.redundant_with_ = [finding.redundant_with for finding in findings]

    def _backward(self, criterion, sensors):
        """Return what backward elimination leaves where the score is greatest."""
        ranking, scores = backward_elimination(criterion, sensors)
        return ranking[: int(np.argmax(scores)) + 1]

    def _choose_bins(self, samples, units):
        """Return the number of time bins, and the criterion."""
        if self.max_time_bins == 'auto':
            return choose_time_bins(lambda bins: self._criterion(samples, bins), units)
        return self.max_time_bins, self._criterion(samples, self.max_time_bins)

    def _check_parameters(self):
        for name in ('gamma', 'tuning_window', 'num_centers', 'significance', 'margin', 'n_jobs'):
            value = getattr(self, name)
            if not isinstance(value, Real) and not (value is None and name == 'num_centers'):
                raise ValueError(f'{name} is {value!r}; expected a number')
        bins = self.max_time_bins
        if bins is not None and bins != 'auto' and (isinstance(bins, str) or bins < 1):
            raise ValueError(
                f"max_time_bins is {bins!r}; expected at least 1, None for no bins, or 'auto'"
            )
        if self.tuning_window < 0:
            raise ValueError(f'tuning_window is {self.tuning_window}; expected at least 0')
        if self.target not in TARGETS:
            raise ValueError(f'target is {self.target!r}; expected one of {", ".join(TARGETS)}')
        if not 0 < self.margin < 1:
            raise ValueError(f'margin is {self.margin}; expected 0 < margin < 1')
        if not 0 < self.significance < 1:
            raise ValueError(f'significance is {self.significance}; expected 0 < significance < 1')
        if self.n_jobs < 1:
            raise ValueError(f'n_jobs is {self.n_jobs}; expected at least 1')

    def _samples(self, episodes) -> Samples:
        return collect_samples(episodes, gamma=self.gamma, standardize=self.standardize)

    def _criterion(self, samples: Samples, bins: int | None) -> Criterion:
        is_default = self.criterion == 'held_out'
        widths: dict[str, Any] = {'widths': WIDTHS} if is_default else {}
        estimator = Lsmi(criterion=self.criterion, num_centers=self.num_centers, **widths)
        actions = samples.actions
        if self.target == ACTION:
            samples, actions = replace(samples, returns=actions[:, 0]), actions[:, :0]
        if self.standardize:
            samples = replace(samples, returns=standardized(normal_scores(samples.returns)))
        given = samples.states.shape[1] + np.arange(actions.shape[1])
        steps = split_by_step(
            samples.with_channels(actions),
            max_time_bins=bins,
            num_folds=estimator.num_folds,
            num_centers=self.num_centers,
            random_state=self.random_state,
            max_samples=_MAX_SAMPLES if is_default else None,
        )
        score = ConditionalMI(
            steps, estimator, tuning_window=self.tuning_window, n_jobs=self.n_jobs
        )
        return lambda subsets: score([[*subset, *given] for subset in subsets])
