# SPDX-License-Identifier: Apache-2.0

"""The selector: sensors with evidence that the return depends on them, ranked by score."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .blas_threads import one_blas_thread
from .criterion import make_criterion
from .data_checks import problems_of_data, problems_of_held_actions, problems_of_skill
from .episode import Episode, as_episodes
from .evidence_ranking import EvidenceRanking, rank_by_evidence
from .fingerprints import fingerprint, first_of_each
from .parameter_checks import check_parameters
from .permutation import PermutationTest, permutation_test
from .samples import Samples, scaled
from .search import Criterion
from .sensor_selector import Ranking, SensorSelector
from .statuses import DISPENSABLE, FEWEST_EPISODES, UNDECIDED
from .targets import ACTION, DECISION, RETURN, TargetTest
from .thinning import MAX_STEPS, Plan, ThinnedEpisodes, plan_of, thinned
from .time_bins import MOST_BINS

#: Episodes are shifted where signs give no more, so that no p-value depends on a smaller level.
_LEAST_SHIFTED = 0.05
_NO_ACTIONS = (
    'there are no actions: a sensor that a controller needs to choose its action may seem '
    'dispensable; record them, and name them (under `actions` in a robot file)'
)


class ConditionalMISelector(SensorSelector):
    """Select the sensors that the return, the action or a decision depends on.

    In each round a test finds the sensors that are informative given those selected so far; the one
    with the best score is added. At the end each selected sensor is tested given all the others.
    Further attributes are those of `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        Number of sensors to select. None selects the confirmed ones, which may be none.
    target : {'return', 'decision', 'action'}
        The question; see `targets`. The score is that of the return, with 'action' that of the
        first action.
    gamma : float
        Discount factor of the return, 0 < gamma <= 1.
    criterion : {'held_out', 'plug_in'}
        See `Lsmi`. 'plug_in' ranks by the score alone, without a test; if `num_features` is None,
        it selects all sensors.
    standardize : bool
        Replace channels and returns by their normal scores over all samples.
    direction : {'forward', 'backward'}
        Forward selection, or backward elimination, whose first sensors are then tested.
    groups : mapping of str to sequence of (str or int), optional
        Sensors of several channels: name to channel names or indices. A channel in no group is a
        sensor of its own. Sensors are selected as a whole; forward selection also finds the
        channels that support each.
    max_time_bins : int or 'auto', optional
        Neighbouring steps of longer episodes are pooled into this many bins; None never pools.
        'auto' chooses between 32 bins and a single one by their scores.
    tuning_window : int
        Number of steps (or bins) on either side that share in the choice of a step's kernel width
        and regularisation; see `ConditionalMI`.
    num_centers : int, optional
        Greatest number of kernel centres in a step; None uses all samples.
    significance : float
        Probability that any sensor is confirmed when none is informative, 0 < significance < 1.
    margin : float
        A sensor that adds less than this share of the target's variance is dispensable.
    random_state : int
        Seed. The same seed and data give the same result bit for bit on one machine.
    n_jobs : int
        Number of threads.

    Attributes
    ----------
    pvalues_ : numpy.ndarray, shape (S,)
        For each of the S ranked sensors, the p-value of the hypothesis that it is uninformative
        given the confirmed ones, corrected for the number of candidates.
    statuses_ : list of str
        One of `STATUSES` for each ranked sensor.
    effects_ : list of Effect
        What each sensor adds to what the other confirmed sensors predict of the target.
    why_ : list of str
        The variable of the target for which the evidence for each sensor is strongest.
    predicted_share_, predicted_share_of_all_, predicted_share_of_none_ : float
        Share of the target's variance that the selected sensors, all sensors, and none predict in
        held-out episodes, each together with the step and the action.
    warnings_ : list of str
        What the data cannot show. Each is also passed to `warnings.warn`.
    null_scores_ : numpy.ndarray, shape (S, 3)
        5 %, median and 95 % of the scores of uninformative sensors at the same rank: a prediction
        interval from six shadows, whose trajectories are exchanged between episodes.
    supporting_channels_ : list of tuple of int
        The channels that carry the evidence for each sensor, best first; none for a constant one.
    redundant_with_ : list of tuple of int
        For each ranked sensor, the confirmed sensors it is redundant with: it would have strong
        evidence without one of them, but is not confirmed given all of them.
    together_with_ : list of tuple of int
        For each ranked sensor that is undecided although it adds less than the margin alone: the
        other unconfirmed sensors with which it may add more.
    num_duplicates_ : int
        Number of exact copies of other episodes, which are left out.

    Notes
    -----
    Results refer to the policy that collected the episodes; other sensors may matter under another.

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
        """Return a selector with the paper's settings: raw features, Equation (10), B = M."""
        paper: dict[str, Any] = {
            'criterion': 'plug_in',
            'standardize': False,
            'max_time_bins': None,
            'tuning_window': 0,
            'num_centers': None,
        }
        return cls(num_features, **(paper | options))

    def single_scores(self, episodes, names: Sequence[str] | None = None) -> np.ndarray:
        """Return the score of each sensor alone: shape (S,). Nothing is fitted.

        Parameters
        ----------
        episodes, names
            As of `fit`.

        Raises
        ------
        ValueError
            If a parameter or the data are invalid; the message names the value.

        """
        episodes, names, _, sensors = self._checked(episodes, names)
        check_parameters(self.get_params())
        with one_blas_thread():
            return self._criterion(self._samples(self._thinned(episodes)), self._bins)(sensors)

    def permutation_test(
        self, episodes, names: Sequence[str] | None = None, *, n_permutations: int = 99
    ) -> PermutationTest:
        """Test whether the target depends on any sensor; see `permutation.permutation_test`."""
        return permutation_test(self, episodes, names, n_permutations=n_permutations)

    @property
    def _bins(self) -> int | None:
        """The number of time bins, without a choice by the data."""
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
            As of `SensorSelector.fit`; a third array (M, N, a) may hold the actions.
        action_names : sequence of str, optional
            One name for each value of the actions; action0, action1, ... by default.
        ordered : bool
            Whether the episodes are in the order of time; slow drift, which any two slow signals
            share, is then no evidence. Set False if the order means nothing.

        """
        self._ordered, self._action_names = ordered, action_names
        try:
            super().fit(episodes, names, start=start, progress=progress)
        finally:
            del self._ordered, self._action_names
        return self

    def thin(self, episodes) -> ThinnedEpisodes:
        """Return what `fit` looks at: the episodes without copies, thinned by `random_state`.

        Parameters
        ----------
        episodes : iterable of Episode or arrays
            As of `fit`.

        Raises
        ------
        ValueError
            If a parameter or the data are invalid, or all episodes are the same.

        """
        check_parameters(self.get_params())
        episodes = as_episodes(episodes)
        which = first_of_each([fingerprint(episode) for episode in episodes])
        if len(which) < min(2, len(episodes)):
            raise ValueError(
                f'all {len(episodes)} episodes are identical; expected at least 2 different ones'
            )
        found = self._thinned([episodes[i] for i in which])
        return replace(found, places=which, num_copies=len(episodes) - len(which))

    def _thinned(self, episodes: Sequence[Episode]) -> ThinnedEpisodes:
        lengths = [len(episode) for episode in episodes]
        return thinned(episodes, self.gamma, self.plan(lengths))

    def plan(self, lengths: Sequence[int]) -> Plan:
        """Return which steps `fit` looks at of different episodes of given lengths."""
        return plan_of(
            lengths,
            self.random_state,
            max_steps=None if self.criterion == 'plug_in' else MAX_STEPS,
            with_next=self.target == DECISION,
        )

    def _taken(self, episodes):
        if isinstance(episodes, ThinnedEpisodes):
            return episodes, episodes.num_channels
        return super()._taken(episodes)

    def _rank(self, episodes, names, sensors):
        check_parameters(self.get_params())
        if not isinstance(episodes, ThinnedEpisodes):
            episodes = self.thin(episodes)
        with one_blas_thread():
            return self._ranked(episodes, names, sensors)

    def _ranked(self, episodes: ThinnedEpisodes, names, sensors):
        self.warnings_: list[str] = []
        self.predicted_share_ = self.predicted_share_of_all_ = 0.0
        self.predicted_share_of_none_ = 0.0
        self.num_duplicates_ = episodes.num_copies
        samples = self._samples(episodes)
        if self.criterion == 'plug_in':
            self._keep_evidence(EvidenceRanking.of_nothing())
            return self._rank_by_score(self._criterion(samples, self._bins), sensors)
        self._warn_of(problems_of_data(episodes, names, ordered=self._ordered))
        varying = np.ptp(samples.states, axis=0) > 0
        live = [i for i, sensor in enumerate(sensors) if varying[list(sensor)].any()]
        constant = [i for i in range(len(sensors)) if i not in live]
        if self.num_features is not None and self.num_features > len(live):
            raise ValueError(
                f'num_features is {self.num_features}, but only {len(live)} sensors ever change: '
                f'constant are {", ".join(names[sensors[i][0]] for i in constant)}'
            )
        found = EvidenceRanking.of_nothing()
        if live:
            varying_channels = [tuple(c for c in sensors[i] if varying[c]) for i in live]
            test = self._test(samples, names)
            found = rank_by_evidence(
                samples,
                test,
                self._criterion,
                varying_channels,
                start=[i for i, sensor in enumerate(live) if sensor in self._start],
                num_features=self.num_features,
                direction=self.direction,
                max_time_bins=self.max_time_bins,
                significance=self.significance,
                margin=self.margin,
                rng_seed=[self.random_state, 3],
                progress=self._progress,
            )
            selected = [c for f in found.findings[: found.num_selected] for c in f.channels]
            self.predicted_share_ = test.predicted_share(selected)
            self.predicted_share_of_all_ = test.predicted_share(np.flatnonzero(varying).tolist())
            self.predicted_share_of_none_ = test.predicted_share([])
        found = found.renumbered(live)
        if self.num_features is None:
            # A sensor may change only in steps that are not looked at.
            changes = np.ptp(episodes.ranges, axis=0) > 0
            never = DISPENSABLE if len(episodes) >= FEWEST_EPISODES else UNDECIDED
            statuses = {
                i: UNDECIDED if changes[list(sensors[i])].any() else never for i in constant
            }
            found = found.followed_by_constant(statuses)
        self._keep_evidence(found)
        ranking = [f.sensor for f in found.findings]
        return Ranking(ranking, [f.score for f in found.findings], found.num_selected)

    def _test(self, samples: Samples, names: Sequence[str]) -> TargetTest:
        num_actions = samples.actions.shape[1]
        action_names = self._action_names or [f'action{i}' for i in range(num_actions)]
        if len(action_names) != num_actions:
            raise ValueError(
                f'there are {len(action_names)} action_names; expected {num_actions}, '
                'one for each action value'
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
        if self.target == DECISION and not num_actions:
            self._warn_of([_NO_ACTIONS])
        check = {RETURN: problems_of_skill, ACTION: problems_of_held_actions}.get(self.target)
        if num_actions and check is not None:
            acting = samples.with_previous_actions()
            shown = [*names, *(f'previous {name}' for name in action_names)]
            shares = TargetTest(acting, ACTION, shown, action_names, self.gamma).predicted_shares
            self._warn_of(check(shares, samples.states.shape[1], num_actions))
        return test

    def _warn_of(self, problems: Sequence[str]) -> None:
        for problem in problems:
            self.warnings_.append(problem)
            warnings.warn(problem, stacklevel=7)

    def _keep_evidence(self, found: EvidenceRanking) -> None:
        self.pvalues_ = np.array([finding.pvalue for finding in found.findings])
        self.statuses_ = [verdict.status for verdict in found.verdicts]
        self.effects_ = [verdict.effect for verdict in found.verdicts]
        self.why_ = [verdict.why for verdict in found.verdicts]
        self.together_with_ = [verdict.together_with for verdict in found.verdicts]
        self.null_scores_ = found.null_scores
        self.supporting_channels_ = [finding.channels for finding in found.findings]
        self.redundant_with_ = [finding.redundant_with for finding in found.findings]

    def _samples(self, episodes: ThinnedEpisodes) -> Samples:
        return scaled(episodes.samples) if self.standardize else episodes.samples

    def _criterion(self, samples: Samples, num_bins: int | None) -> Criterion:
        return make_criterion(
            samples,
            num_bins,
            target=self.target,
            criterion=self.criterion,
            standardize=self.standardize,
            num_centers=self.num_centers,
            tuning_window=self.tuning_window,
            random_state=self.random_state,
            n_jobs=self.n_jobs,
        )
