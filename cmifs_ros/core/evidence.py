"""Tests whether a sensor tells something about the return that the others selected do not.

A kernel test of conditional independence (Zhang, Peters, Janzing & Schoelkopf, Kernel-based
conditional independence test and application in causal discovery, 2011), made for episodes: what
the given channels and the time step explain is taken from the return and from functions of the
sensor, and the two remainders are multiplied. If the sensor tells nothing more, the products of an
episode sum up to either sign with equal chance, whatever the steps of it have to do with each
other (the wild cluster bootstrap: Cameron, Gelbach & Miller, Bootstrap-based improvements for
inference with clustered errors, 2008).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from .kernel_ridge import KernelRidge, squared_distances
from .samples import Samples, standardized

#: More rows are thinned evenly: neighbouring steps of an episode tell nearly the same.
_MAX_ROWS = 4000
_NUM_FOLDS = 5
#: Gaussians that explain the return by what is given, and those that are functions of the sensor.
_NUM_CENTERS, _NUM_FUNCTIONS = 80, 60
#: Widths of these functions, and how far they are whitened: from only the strongest to all.
_WIDTHS = (0.5, 1.0, 2.0)
_WHITENINGS = (1e-1, 1e-2, 1e-3)
_NUM_SIGNS = 2000
#: Share of its variance that a sensor must have for itself.
_LEAST_OWN_SHARE = 1e-3


class ConditionalTest:
    """Test channels given others.

    Parameters
    ----------
    samples : Samples
    random_state : int
        Seed of folds, centres and signs.

    """

    def __init__(self, samples: Samples, random_state: int):
        rng = np.random.default_rng([random_state, 1])
        stride = -(-len(samples.step) // _MAX_ROWS)
        rows = np.flatnonzero((samples.step + samples.owner) % stride == 0)
        self._returns = standardized(samples.returns[rows])
        self._states = standardized(samples.states[rows])
        self._owner = samples.owner[rows]
        self._step = standardized(samples.step[rows].astype(float))
        num_episodes = samples.owner[-1] + 1
        num_folds = min(_NUM_FOLDS, num_episodes)
        self._folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[self._owner]
        centers = rng.permutation(len(rows))
        self._centers, self._functions = centers[:_NUM_CENTERS], centers[:_NUM_FUNCTIONS]
        self._signs = rng.choice([-1.0, 1.0], size=(_NUM_SIGNS, num_episodes))
        self._known: dict[tuple, float] = {}
        self._given: tuple = (None,)

    def __call__(self, channels: Sequence[int], given: Sequence[int]) -> float:
        """Return the p-value of channels given others; nothing is corrected for choices."""
        key = tuple(channels), frozenset(given)
        if key not in self._known:
            self._known[key] = self._test(list(channels), sorted(given))
        return self._known[key]

    def _test(self, channels, given) -> float:
        points, regression, left, choice = self._explained_by(given)
        sensor = self._states[:, channels]
        own = np.column_stack(
            [
                regression.residual(column[:, None], fit)
                for column, fit in zip(sensor.T, regression.tuned(sensor), strict=True)
            ]
        )
        own = own[:, np.var(own, axis=0) > _LEAST_OWN_SHARE * np.var(sensor, axis=0)]
        if not own.shape[1]:
            return 1.0
        own = own / own.std(axis=0)
        sums = [
            self._sums(regression.residual(functions, choice), left)
            for functions in self._functions_of(own, points)
        ]
        return self._pvalue([s / np.sqrt(v + r * v.max()) for s, v in sums for r in _WHITENINGS])

    def _explained_by(self, given):
        """Return the given channels with the step, the regression on them, and the rest of it."""
        if self._given[0] != given:
            points = np.column_stack([self._states[:, given], self._step])
            regression = KernelRidge(points, self._centers, self._folds)
            returns = self._returns[:, None]
            choice = regression.tuned(returns)[0]
            left = regression.residual(returns, choice)
            self._given = given, (points, regression, left, choice)
        return self._given[1]

    def _functions_of(self, own, points):
        """Return, for each width, functions of the sensor, also of it and what is given."""
        of_sensor = squared_distances(own, own[self._functions]) / own.shape[1]
        of_given = squared_distances(points, points[self._functions]) / points.shape[1]
        for width in _WIDTHS:
            kernel = np.exp(of_sensor / (-2 * width**2))
            kernel -= kernel.mean(axis=0)  # no function of the given channels alone
            yield np.hstack([kernel * np.exp(of_given / (-2 * width**2)), own])

    def _sums(self, functions, left):
        """Return each episode's sums along the functions' principal axes, and their variances."""
        variances, axes = np.linalg.eigh(functions.T @ functions / len(functions))
        sums = np.zeros((self._signs.shape[1], functions.shape[1]))
        np.add.at(sums, self._owner, functions * left)
        return sums @ axes, np.maximum(variances, 0)

    def _pvalue(self, whitened: Sequence[np.ndarray]) -> float:
        """Return the probability that the signs alone bring about sums that large.

        The greatest of all statistics, each divided by its deviation, is compared with a law of
        three moments (Winkler et al., Faster permutation inference in brain imaging, 2016).
        """
        greatest, null = -np.inf, np.full(len(self._signs), -np.inf)
        for sums in whitened:
            each = (sums**2).sum(axis=1)
            deviation = np.sqrt(max(2 * (((sums.T @ sums) ** 2).sum() - (each**2).sum()), 0.0))
            if deviation <= 1e-12 * each.sum():
                continue
            greatest = max(greatest, ((sums.sum(axis=0) ** 2).sum() - each.sum()) / deviation)
            drawn = ((self._signs @ sums) ** 2).sum(axis=1)
            null = np.maximum(null, (drawn - each.sum()) / deviation)
        spread = null.std() if np.isfinite(greatest) else 0.0
        if spread == 0:
            return 1.0
        law = stats.pearson3(stats.skew(null), loc=null.mean(), scale=spread)
        return float(law.sf(greatest))
