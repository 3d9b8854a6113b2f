# SPDX-License-Identifier: Apache-2.0

r"""Tests whether the target depends on a sensor given the sensors selected.

A kernel test of conditional independence (Zhang, Peters, Janzing & Schoelkopf, Kernel-based
conditional independence test and application in causal discovery, 2011), made for episodes. With y
the return, z what is given (the sensors selected, the action and the step) and x the sensor:

1. :math:`\varepsilon_t = y_t - \hat E[y_t | z_t]`, by kernel regression.
2. :math:`\delta_t = \varepsilon_t - \gamma \varepsilon_{t+1}`, the TD residual of Sutton (Learning
   to predict by the methods of temporal differences, 1988). It has less noise than
   :math:`\varepsilon_t`, but shows nothing of a sensor that is read early and matters late, so both
   are used. The mean of :math:`\delta_t` given z need not be 0: they are regressed on z again.
3. Functions f of x and z, Gaussians and products, lose their projection on the same space as
   these: what is left of the two is orthogonal to all that z explains of either
   (Frisch-Waugh-Lovell). The step is all that an irrelevant sensor and the return have in common,
   so slow cosines of it are in every regression.
4. The products :math:`s_i = \sum_t f_{it} \delta_{it} / \sqrt{T_i}` of each episode i are added up.
   If y does not depend on x given z, the sign of each :math:`s_i` is random, however the steps
   within an episode depend on each other (the wild cluster bootstrap). Neighbouring episodes that
   resemble each other, such as windows of one drive, form a block and share one sign.
5. If the signs show a dependence, it is tested once more with the residuals of other episodes:
   cyclic shifts of the episodes, which keep the autocorrelation of both sides. This alone would
   not do, because it assumes that all episodes are alike.

The greater p-value of 4 and 5 counts. Returns enter as they are and as normal scores; the p-values
of all these are combined by a Cauchy combination.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from .drift import num_trends, trends
from .effect import Effect, EffectEstimator
from .episode_rows import EpisodeRows
from .kernel_regression import KernelRegression, extended, residual, squared_distances
from .products import PARTS, Products
from .samples import Samples, normal_scores, standardized
from .threads import in_threads

#: Number of Gaussians in the regressions on what is given: half the number of episodes, within
#: these limits. The more episodes there are, the smaller a misfit that passes for dependence.
_NUM_CENTERS = 50, 100
#: Cosines of the step by which the drift over the episodes may differ: of a return, which has fewer
#: rewards to come at late steps.
_BY_STEP = 3
#: Gaussians that are functions of the sensor.
_NUM_FUNCTIONS = 60
#: Regressors are kept for a second question as long as they have no more rows in all.
_KEPT_ROWS = 20_000
#: A candidate with more channels is reduced to this many principal components.
_MAX_COMPONENTS = 12
#: Share of its variance that a channel must have for itself.
_LEAST_OWN_SHARE = 1e-3


class ConditionalTest:
    """Test channels given others, the action and the time step, and estimate what they add.

    Parameters
    ----------
    samples : Samples
    targets : mapping of str to numpy.ndarray, shape (N,)
        Variables of the target by their names.
    discount : float
        Discount factor where the target is a return; 0 where a step's target is its own.
    of_given : bool
        Variable c of the target counts where channel c is given, and only then.
    random_state : int
        Seed of folds and centres.
    level : float
        p-value by signs up to which episodes are shifted as well.
    parts : collection of str
        Which parts of the test count, of `products.PARTS`; a study looks at each by itself.
    ordered : bool
        Whether the order of the episodes is that of time: then slow drift is taken out, and
        episodes are shifted in their order; else in a random one.
    n_jobs : int
        Threads that share the candidates, and the widths of kernels.

    """

    def __init__(
        self,
        samples: Samples,
        targets: Mapping[str, np.ndarray],
        *,
        discount: float = 0.0,
        of_given: bool = False,
        random_state: int = 0,
        level: float = 0.05,
        parts: Collection[str] = PARTS,
        ordered: bool = True,
        n_jobs: int = 1,
    ):
        self._level, self._parts = level, parts
        self._of_given, self._n_jobs = of_given, n_jobs
        self._rows = EpisodeRows(samples, random_state, ordered)
        self._names = list(targets)
        self._targets = np.column_stack([targets[name] for name in self._names])
        self._discount = discount
        self._known: dict[tuple, dict[str, float]] = {}
        self._contexts: dict[frozenset[int], _Given] = {}

    def pvalues(
        self, candidates: Sequence[Sequence[int]], given: Sequence[int]
    ) -> list[dict[str, float]]:
        """Return the p-value of each candidate, some channels, for each variable of the target.

        Nothing is corrected for the number of candidates or variables. Each is computed once.
        """
        keys = [(tuple(channels), frozenset(given)) for channels in candidates]
        new = [key for key in dict.fromkeys(keys) if key not in self._known]
        if new:
            found = self._test([channels for channels, _ in new], sorted(given))
            self._known.update(zip(new, found, strict=True))
        return [self._known[key] for key in keys]

    def effects(
        self, candidates: Sequence[Sequence[int]], given: Sequence[int]
    ) -> list[dict[str, Effect]]:
        """Return what each candidate, some channels, adds to each variable of the target."""
        estimators, context = self._estimators(given)

        def of_candidate(families):
            functions = np.hstack(families) if families else np.empty((0, 0))
            return {name: estimator.effect(functions) for name, estimator in estimators.items()}

        return self._for_each(of_candidate, candidates, context)

    def added(self, candidate: Sequence[int], given: Sequence[int]) -> dict[str, np.ndarray]:
        """Return what a candidate adds to the prediction of each variable, sample by sample: (N,).

        In standard deviations of the variable.
        """
        estimators, context = self._estimators(given)
        families = context.functions(*context.own([candidate]))
        functions = np.hstack(families) if families else np.empty((0, 0))
        return {name: estimator.added(functions) for name, estimator in estimators.items()}

    def pair_pvalues(self, channels: Sequence[int], given: Sequence[int]) -> dict[str, np.ndarray]:
        """Return the p-values of products of two channels for each variable: shape (k, k).

        By signs alone; where the first channel is not before the second, it is 1.
        """
        columns, context = self._columns(given), self._given(given)
        names = [self._names[c] for c in columns]
        found = {name: np.ones((len(channels), len(channels))) for name in names}
        if not columns:
            return found
        products, variables = self._products(columns, context)
        own = np.hstack(context.own([[c] for c in channels], least=0.0))
        own[:, own.var(axis=0) < _LEAST_OWN_SHARE] = 0.0  # What is left is a rounding error.

        def of_first(i):
            return products.single_pvalues(own[:, [i]] * own[:, i + 1 :], variables)

        firsts = range(len(channels) - 1)
        for i, pvalues in zip(firsts, in_threads(of_first, firsts, self._n_jobs), strict=True):
            for name, of_name in zip(names, pvalues, strict=True):
                found[name][i, i + 1 :] = of_name
        return found

    def pair_bounds(self, channels: Sequence[int], given: Sequence[int]) -> np.ndarray:
        """Return what pairs of channels may add as products, at most: shape (k, k).

        With 95 % confidence for each pair, to the variable of the target to which it may be most.
        """
        estimators, context = self._estimators(given)
        own = np.hstack(context.own([[c] for c in channels], least=0.0))
        bounds = [estimator.pair_bounds(own) for estimator in estimators.values()]
        return np.max([np.zeros((len(channels), len(channels))), *bounds], axis=0)

    def predicted_shares(self, given: Sequence[int]) -> dict[str, float]:
        """Return the share of each variable's variance that is predicted in episodes left out."""
        columns, context = self._columns(given), self._given(given)
        if not columns:
            return {}
        shares = context.regression.predicted_shares(standardized(self._targets[:, columns]))
        return {self._names[c]: float(s) for c, s in zip(columns, shares, strict=True)}

    def _estimators(self, given) -> tuple[dict[str, EffectEstimator], _Given]:
        columns, context = self._columns(given), self._given(given)
        targets = standardized(self._targets[:, columns])
        spaces = context.regression.tuned(targets) if columns else []
        estimators = {}
        for c, target, space in zip(columns, targets.T, spaces, strict=True):
            basis = self._with_drift(context.regression.basis(space), target[:, None])
            starts = self._rows.starts_of_blocks(residual(target[:, None], basis))
            estimators[self._names[c]] = EffectEstimator(target, basis, starts)
        return estimators, context

    def _test(self, candidates, given) -> list[dict[str, float]]:
        columns, context = self._columns(given), self._given(given)
        if not columns:
            return [{}] * len(candidates)
        names = [self._names[c] for c in columns]
        products, variables = self._products(columns, context)

        def of_candidate(families):
            pvalues = products.pvalues(families, variables) if families else [1.0] * len(names)
            return dict(zip(names, pvalues, strict=True))

        return self._for_each(of_candidate, candidates, context)

    def _products(self, columns: list[int], context: _Given) -> tuple[Products, list[range]]:
        """Return the residuals of some variables, and which residuals are those of each."""
        left = self._residuals(context.regression, self._targets[:, columns])
        basis = context.regression.basis(context.regression.jointly_tuned(left))
        basis = self._with_drift(basis, left)
        left = residual(left, basis)
        products = Products(
            left,
            basis,
            self._rows.starts,
            self._rows.starts_of_blocks(left),
            self._rows.shifts,
            level=self._level,
            parts=self._parts,
        )
        return products, [range(k, left.shape[1], len(columns)) for k in range(len(columns))]

    def _given(self, channels: Sequence[int]) -> _Given:
        """Return the given channels as regressors; the last few are kept."""
        key = frozenset(channels)
        if key not in self._contexts:
            if len(self._contexts) >= max(1, _KEPT_ROWS // len(self._rows.owner)):
                del self._contexts[next(iter(self._contexts))]
            self._contexts[key] = _Given(self._rows, channels, self._n_jobs)
        return self._contexts[key]

    def _for_each(self, of_candidate: Callable, candidates, context: _Given) -> list:
        """Return what a function gives for the functions of each candidate."""
        own = context.own(candidates)
        return in_threads(lambda o: of_candidate(context.functions(o)), own, self._n_jobs)

    def _columns(self, given) -> list[int]:
        """Return the variables of the target that vary, of those that count given some channels."""
        columns = sorted(given) if self._of_given else range(len(self._names))
        return [c for c in columns if np.ptp(self._targets[:, c]) > 0]

    def _residuals(self, regression: KernelRegression, targets: np.ndarray) -> np.ndarray:
        """Return what is left of targets (N, q), variant after variant, q columns each."""
        both = standardized(np.hstack([targets, normal_scores(targets)]))
        left = regression.residuals(both, regression.tuned(both))
        if self._discount:
            left = np.hstack([left, self._rows.differences(left, self._discount)])
        return left

    def _with_drift(self, basis: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Return the basis with trends over the episodes, by step, if the residuals drift."""
        rows = self._rows
        means = rows.means(residual(left, basis))
        count = num_trends(means, rows.lengths / rows.lengths.mean()) if rows.is_ordered else 0
        slow = trends(len(means), count)[rows.owner]
        by_step = [slow * of_step[:, None] for of_step in rows.step_cosines[:, :_BY_STEP].T]
        return extended(basis, np.hstack([slow, *by_step]))


class _Given:
    """Given channels with the action and the step: what they explain, and functions beside them."""

    def __init__(self, rows: EpisodeRows, channels: Sequence[int], n_jobs: int):
        num_episodes = len(rows.lengths)
        self._states = rows.states
        self._functions = rows.shuffled[:_NUM_FUNCTIONS]
        self._points = np.column_stack([rows.states[:, sorted(channels)], rows.actions, rows.step])
        self.regression = KernelRegression(
            self._points,
            rows.shuffled[: int(np.clip(num_episodes // 2, *_NUM_CENTERS))],
            rows.folds,
            rows.fixed,
            n_jobs,
        )
        self._bumps = self._gaussians(self._points)

    def own(
        self, candidates: Sequence[Sequence[int]], least: float = _LEAST_OWN_SHARE
    ) -> list[np.ndarray]:
        """Return what the given do not explain of each candidate's channels, shapes (N, k).

        Channels of which that is less than a share are left out.
        """
        channels = list(dict.fromkeys(c for candidate in candidates for c in candidate))
        states = self._states[:, channels]
        left = self.regression.residuals(states, self.regression.tuned(states))
        place = {channel: k for k, channel in enumerate(channels)}
        own = [left[:, [place[c] for c in candidate]] for candidate in candidates]
        return [o[:, o.var(axis=0) >= least] for o in own]

    def functions(self, own: np.ndarray) -> list[np.ndarray]:
        """Return two families of functions of what a candidate has for itself: shapes (N, k).

        Products with itself and with each given channel are few, so that few episodes show them;
        Gaussians of it and the given channels together see any shape.
        """
        if not own.size:
            return []
        own = _principal(own / own.std(axis=0))
        squares = np.hstack([own[:, [i]] * own[:, i:] for i in range(own.shape[1])])
        with_given = [own[:, [i]] * self._points for i in range(own.shape[1])]
        bumps = self._gaussians(own)
        bumps -= bumps.mean(axis=0)  # no function of the given channels alone
        return [
            np.hstack([own, *with_given, squares - squares.mean(axis=0)]),
            np.hstack([bumps * self._bumps, own]),
        ]

    def _gaussians(self, points):
        exponents = squared_distances(points, points[self._functions])
        exponents /= -2 * points.shape[1]
        return np.exp(exponents, out=exponents)


def _principal(own: np.ndarray) -> np.ndarray:
    """Return columns (N, k), or their first principal components where they are many."""
    if own.shape[1] <= _MAX_COMPONENTS:
        return own
    variances, axes = np.linalg.eigh(own.T @ own / len(own))
    return own @ (axes / np.sqrt(np.maximum(variances, _LEAST_OWN_SHARE)))[:, -_MAX_COMPONENTS:]
