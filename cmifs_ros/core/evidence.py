"""Tests whether a sensor tells something about the return that the others selected do not.

A kernel test of conditional independence (Zhang, Peters, Janzing & Schoelkopf, Kernel-based
conditional independence test and application in causal discovery, 2011), made for episodes: what
the given channels and the time step explain is taken from the return and from functions of the
sensor, and the two remainders are multiplied. If the sensor tells nothing more, the products of an
episode sum up to either sign with equal chance, whatever the steps of it have to do with each
other (the wild cluster bootstrap: Cameron, Gelbach & Miller, Bootstrap-based improvements for
inference with clustered errors, 2008).

What is left of the return is looked at as it is and by its temporal differences (Sutton, Learning
to predict by the methods of temporal differences, 1988): what a step alone adds has less noise than
all that comes after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy import special

from .kernel_ridge import KernelRidge, squared_distances
from .samples import Samples, standardized

#: More rows are thinned evenly: neighbouring steps of an episode tell nearly the same.
_MAX_ROWS = 2000
_NUM_FOLDS = 5
#: Gaussians that explain the return by what is given, and those that are functions of the sensor.
_NUM_CENTERS, _NUM_FUNCTIONS = 50, 60
#: How far these functions are whitened: from only the strongest to all.
_WHITENINGS = (1e-1, 1e-2, 1e-3)
_NUM_SIGNS = 2000
#: Share of its variance that a sensor must have for itself.
_LEAST_OWN_SHARE = 1e-3


class ConditionalTest:
    """Test channels given others and the time step.

    Parameters
    ----------
    samples : Samples
    gamma : float
        Discount factor of the returns.
    random_state : int
        Seed of folds, centres and signs.

    """

    def __init__(self, samples: Samples, gamma: float, random_state: int):
        rng = np.random.default_rng([random_state, 1])
        stride = -(-len(samples.step) // _MAX_ROWS)
        rows = np.flatnonzero((samples.step + samples.owner) % stride == 0)
        self._returns = standardized(samples.returns[rows])
        self._states = standardized(samples.states[rows])
        owner = samples.owner[rows]
        self._episodes = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(owner)) + 1)
        self._discount = gamma**stride
        self._step = standardized(samples.step[rows].astype(float))
        num_episodes = samples.owner[-1] + 1
        num_folds = min(_NUM_FOLDS, num_episodes)
        self._folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[owner]
        centers = rng.permutation(len(rows))
        self._centers, self._functions = centers[:_NUM_CENTERS], centers[:_NUM_FUNCTIONS]
        self._signs = rng.choice([-1.0, 1.0], size=(_NUM_SIGNS, len(self._episodes)))
        self._known: dict[tuple, float] = {}
        self._given: tuple = (None,)

    def __call__(self, channels: Sequence[int], given: Sequence[int]) -> float:
        """Return the p-value of channels given others; nothing is corrected for choices."""
        key = tuple(channels), frozenset(given)
        if key not in self._known:
            self._known[key] = self._test(list(channels), sorted(given))
        return self._known[key]

    def _test(self, channels, given) -> float:
        points, regression, choice, remainders = self._explained_by(given)
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
        functions = self._functions_of(own / own.std(axis=0), points)
        functions = regression.residual(functions, choice)
        variances, axes = np.linalg.eigh(functions.T @ functions / len(functions))
        functions = functions @ axes
        products = [
            (functions.T @ left, self._sums(functions, errors)) for left, errors in remainders
        ]
        return self._pvalue(products, variances)

    def _explained_by(self, given):
        """Return the regression on the given channels and the step, and what it leaves.

        The remainders are the residual and its temporal differences, each after a fit to all
        episodes and of each episode after a fit to the others, which shows all of the errors.
        """
        if self._given[0] != given:
            points = np.column_stack([self._states[:, given], self._step])
            regression = KernelRidge(points, self._centers, self._folds)
            choice = regression.tuned(self._returns[:, None])[0]
            left = regression.residual(self._returns[:, None], choice)[:, 0]
            errors = regression.left_out(left, choice, self._episodes)
            changes = self._differences(left), self._differences(errors)
            self._given = given, (points, regression, choice, [(left, errors), changes])
        return self._given[1]

    def _differences(self, residual):
        """Return residuals less the discounted ones of the next row: the Bellman residuals."""
        differences = residual.copy()
        for rows in self._episodes:
            differences[rows[:-1]] -= self._discount * residual[rows[1:]]
        return differences

    def _functions_of(self, own, points):
        """Return functions of what the sensor has for itself and of what is given: (N, k)."""
        of_sensor, of_given = (
            np.exp(squared_distances(p, p[self._functions]) / (-2 * p.shape[1]))
            for p in (own, points)
        )
        of_sensor -= of_sensor.mean(axis=0)  # no function of the given channels alone
        return np.hstack([of_sensor * of_given, own])

    def _sums(self, functions, errors):
        """Return the sum of the products in each episode: shape (M, k)."""
        return np.stack([functions[rows].T @ errors[rows] for rows in self._episodes])

    def _pvalue(self, products: list[tuple[np.ndarray, np.ndarray]], variances) -> float:
        """Return the probability that signs alone bring about totals that large.

        The greatest of several statistics, each divided by its deviation, is compared with a law
        of three moments (Winkler et al., Faster permutation inference in brain imaging, 2016).
        """
        variances = np.maximum(variances, 0)
        greatest, null = -np.inf, np.full(len(self._signs), -np.inf)
        for (total, sums), share in product(products, _WHITENINGS):
            weights = 1 / np.sqrt(variances + share * variances.max())
            each = sums * weights
            expected = (each**2).sum()
            deviation = 2 * (((each.T @ each) ** 2).sum() - ((each**2).sum(axis=1) ** 2).sum())
            if deviation <= (1e-12 * expected) ** 2:
                continue
            deviation = np.sqrt(deviation)
            greatest = max(greatest, (((total * weights) ** 2).sum() - expected) / deviation)
            drawn = ((self._signs @ each) ** 2).sum(axis=1)
            null = np.maximum(null, (drawn - expected) / deviation)
        mean, spread = (null.mean(), null.std()) if np.isfinite(greatest) else (0.0, 0.0)
        if spread == 0:
            return 1.0
        null = (null - mean) / spread
        return _pearson3_sf((greatest - mean) / spread, np.mean(null**3))


def _pearson3_sf(value: float, skewness: float) -> float:
    """Return scipy.stats.pearson3.sf(value, skewness); its module takes long to import."""
    if abs(skewness) < 1e-3:
        return float(special.ndtr(-value))
    shape = 4 / skewness**2
    drawn = max(shape + 2 * value / skewness, 0.0)
    tail = special.gammaincc if skewness > 0 else special.gammainc
    return float(tail(shape, drawn))
