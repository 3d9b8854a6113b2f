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

import numpy as np
from scipy import special

from .kernel_ridge import KernelRidge, squared_distances
from .samples import Samples, standardized

#: More rows are thinned evenly: neighbouring steps of an episode tell nearly the same.
_MAX_ROWS = 2000
_NUM_FOLDS = 5
#: Gaussians that explain the return by what is given, and those that are functions of the sensor.
_NUM_CENTERS, _NUM_FUNCTIONS = 50, 60
#: How far these functions are whitened: only the strongest, and all but the weakest, which few
#: episodes have to do with.
_WHITENINGS = (1e-1, 1e-2)
_NUM_SIGNS = 2000
#: Share of its variance that a channel must have for itself.
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
        self._starts = np.flatnonzero(np.diff(owner, prepend=-1))
        self._episodes = np.split(np.arange(len(rows)), self._starts[1:])
        self._discount = gamma**stride
        self._step = standardized(samples.step[rows].astype(float))
        num_episodes = samples.owner[-1] + 1
        num_folds = min(_NUM_FOLDS, num_episodes)
        self._folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[owner]
        centers = rng.permutation(len(rows))
        self._centers, self._functions = centers[:_NUM_CENTERS], centers[:_NUM_FUNCTIONS]
        self._signs = rng.choice([-1.0, 1.0], size=(_NUM_SIGNS, len(self._episodes)))
        self._known: dict[tuple, float] = {}

    def __call__(self, candidates: Sequence[Sequence[int]], given: Sequence[int]) -> np.ndarray:
        """Return the p-value of each candidate, some channels, given others: shape (C,).

        Nothing is corrected for the number of candidates. Each is computed once.
        """
        keys = [(tuple(channels), frozenset(given)) for channels in candidates]
        new = [key for key in dict.fromkeys(keys) if key not in self._known]
        if new:
            pvalues = self._test([list(channels) for channels, _ in new], sorted(given))
            self._known.update(zip(new, pvalues, strict=True))
        return np.array([self._known[key] for key in keys])

    def _test(self, candidates, given):
        points = np.column_stack([self._states[:, given], self._step])
        regression = KernelRidge(points, self._centers, self._folds)
        choice = regression.tuned(self._returns[:, None])[0]
        left = regression.residual(self._returns[:, None], choice)[:, 0]
        errors = regression.left_out(left, choice, self._episodes)
        # Each after a fit to all episodes, and after a fit to the others, which shows all errors.
        remainders = [(left, errors), (self._differences(left), self._differences(errors))]
        of_given = self._gaussians(points)
        channels = list(dict.fromkeys(c for candidate in candidates for c in candidate))
        fits = dict(zip(channels, regression.tuned(self._states[:, channels]), strict=True))
        pvalues = []
        for candidate in candidates:
            own = [
                regression.residual(self._states[:, [channel]], fits[channel])[:, 0]
                for channel in candidate
            ]
            own = [o / o.std() for o in own if o.var() > _LEAST_OWN_SHARE]
            if own:
                functions = self._functions_of(np.column_stack(own), of_given)
                functions = regression.residual(functions, choice)
                pvalues.append(self._pvalue(functions, remainders))
            else:
                pvalues.append(1.0)
        return pvalues

    def _differences(self, residual):
        """Return residuals less the discounted ones of the next row: the Bellman residuals."""
        differences = residual.copy()
        for rows in self._episodes:
            differences[rows[:-1]] -= self._discount * residual[rows[1:]]
        return differences

    def _gaussians(self, points):
        distances = squared_distances(points, points[self._functions])
        return np.exp(distances / (-2 * points.shape[1]))

    def _functions_of(self, own, of_given):
        """Return functions of what the sensor has for itself and of what is given: (N, k)."""
        of_sensor = self._gaussians(own)
        of_sensor -= of_sensor.mean(axis=0)  # no function of the given channels alone
        return np.hstack([of_sensor * of_given, own])

    def _pvalue(self, functions: np.ndarray, remainders) -> float:
        """Return the probability that signs alone bring about products that large.

        The greatest of several statistics, each divided by its deviation, is compared with a law
        of three moments (Winkler et al., Faster permutation inference in brain imaging, 2016).
        """
        variances, axes = np.linalg.eigh(functions.T @ functions / len(functions))
        variances = np.maximum(variances, 0)
        greatest, null = -np.inf, np.full(len(self._signs), -np.inf)
        for left, errors in remainders:
            total = (left @ functions @ axes) ** 2
            sums = np.add.reduceat(functions * errors[:, None], self._starts) @ axes
            squares, products = sums**2, (sums.T @ sums) ** 2
            drawn = (self._signs @ sums) ** 2
            for share in _WHITENINGS:
                weights = 1 / (variances + share * variances.max())
                each = squares @ weights
                expected = each.sum()
                deviation = 2 * (weights @ products @ weights - each @ each)
                if deviation <= (1e-12 * expected) ** 2:
                    continue
                deviation = np.sqrt(deviation)
                greatest = max(greatest, (total @ weights - expected) / deviation)
                null = np.maximum(null, (drawn @ weights - expected) / deviation)
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
