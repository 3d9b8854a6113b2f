r"""Tests whether the target depends on a sensor given the sensors selected.

A kernel test of conditional independence (Zhang, Peters, Janzing & Schoelkopf, Kernel-based
conditional independence test and application in causal discovery, 2011), made for episodes. With y
the return, z what is given (the sensors selected, the action and the step) and x the sensor:

1. :math:`\varepsilon_t = y_t - \hat E[y_t | z_t]`, by kernel regression.
2. :math:`\delta_t = \varepsilon_t - \lambda \gamma \varepsilon_{t+1}`, the TD residual of Sutton
   (Learning to predict by the methods of temporal differences, 1988), for two :math:`\lambda`. It
   has less noise than the return, but its mean given z need not be 0: it is regressed on z again.
3. Functions f of x and z, Gaussians and products, lose their projection on the same space as
   :math:`\delta`: what is left of the two is orthogonal to all that z explains of either
   (Frisch-Waugh-Lovell).
4. The products :math:`s_i = \sum_t f_{it} \delta_{it} / \sqrt{T_i}` of each episode i are added up.
   If y does not depend on x given z, each :math:`s_i` may as well have the opposite sign, whatever
   the steps of an episode have to do with each other (the wild cluster bootstrap). This counts on
   independent episodes.
5. What seems dependent is tested once more, with the residuals of other episodes: cyclic shifts of
   the episodes in their order, which keep the memory of both sides. This counts on episodes alike.

The greater p-value of 4 and 5 counts. Returns enter as they are and as normal scores, and functions
whitened in two degrees; the p-values of all these are combined by a Cauchy combination.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numba import njit

from .chance import combined_pvalue, resampled_pvalues, sign_flip_pvalue
from .drift import cosines, num_cosines
from .kernel_regression import (
    KernelRegression,
    corrected_residual,
    residual,
    squared_distances,
)
from .samples import Samples, normal_scores, standardized

#: More rows are thinned evenly: neighbouring steps of an episode are nearly the same.
_MAX_ROWS = 32_000
_NUM_FOLDS = 5
#: Gaussians that explain the target by what is given, and those that are functions of the sensor.
_NUM_CENTERS, _NUM_FUNCTIONS = 50, 60
#: How far the functions are whitened: the strongest alone, and all but the weakest.
_WHITENINGS = np.array([1e-1, 1e-2])
#: lambda of the TD residual.
_LAMBDAS = (0.6, 1.0)
_MAX_SHIFTS = 300
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
        Seed of folds and centres.
    level : float
        p-value by signs up to which episodes are shifted as well.
    ordered : bool
        Whether the order of the episodes is that of time: then slow drift is taken out, and
        episodes are shifted in their order; else in a random one.

    """

    def __init__(
        self,
        samples: Samples,
        gamma: float,
        random_state: int,
        *,
        level: float = 0.05,
        ordered: bool = True,
    ):
        self._level = level
        rng = np.random.default_rng([random_state, 1])
        stride = -(-len(samples.step) // _MAX_ROWS)
        rows = np.flatnonzero((samples.step + samples.owner) % stride == 0)
        returns = samples.returns[rows]
        self._returns = standardized(np.column_stack([returns, normal_scores(returns)]))
        self._states = standardized(samples.states[rows])
        self._discount = gamma**stride
        self._step = standardized(samples.step[rows].astype(float))
        kept, self._owner = np.unique(samples.owner[rows], return_inverse=True)
        self._actions = standardized(samples.actions[rows])
        self._sources = _pooled(samples.sources[kept])
        self._starts = np.flatnonzero(np.diff(self._owner, prepend=-1))
        self._lengths = np.diff(self._starts, append=len(rows))
        num_episodes = len(kept)
        num_folds = min(_NUM_FOLDS, num_episodes)
        self._folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[self._owner]
        centers = rng.permutation(len(rows))
        self._centers, self._functions = centers[:_NUM_CENTERS], centers[:_NUM_FUNCTIONS]
        self._fixed = self._source_means()
        self._ordered = ordered
        self._order = np.arange(num_episodes) if ordered else rng.permutation(num_episodes)
        self._shifts = self._cyclic_shifts()
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

    def _test(self, candidates, given) -> Iterator[float]:
        points = np.column_stack([self._states[:, given], self._actions, self._step])
        regression = KernelRegression(
            points, self._centers, self._folds, self._fixed, max_rank=len(self._lengths) // 2
        )
        left = self._td_residuals(regression)
        basis = self._with_drift(regression.basis(regression.jointly_tuned(left)), left)
        left = residual(left, basis)
        products = _Products(left, basis, self._starts, self._shifts, self._level)
        channels = list(dict.fromkeys(c for candidate in candidates for c in candidate))
        spaces = dict(zip(channels, regression.tuned(self._states[:, channels]), strict=True))
        of_given = self._gaussians(points)
        bases = {space: regression.basis(space) for space in set(spaces.values())}
        for candidate in candidates:
            own = np.hstack([residual(self._states[:, [c]], bases[spaces[c]]) for c in candidate])
            own = own[:, own.var(axis=0) > _LEAST_OWN_SHARE]
            if own.size:
                own = own / own.std(axis=0)
                yield products.pvalue([_polynomials(own, points), self._bumps(own, of_given)])
            else:
                yield 1.0

    def _td_residuals(self, regression: KernelRegression) -> np.ndarray:
        """Return what is left of the returns less a part of what is left at the next row."""
        left = np.column_stack(
            [
                residual(self._returns[:, [k]], regression.basis(space))
                for k, space in enumerate(regression.tuned(self._returns))
            ]
        )
        following = np.append(left[1:], np.zeros_like(left[:1]), axis=0)
        following[self._starts[1:] - 1] = 0.0
        return np.hstack([left - share * self._discount * following for share in _LAMBDAS])

    def _source_means(self) -> np.ndarray:
        """Return orthonormal columns (N, sources): each source has its own mean (fixed effects)."""
        sources, of_episode = np.unique(self._sources, return_inverse=True)
        columns = (of_episode[self._owner][:, None] == np.arange(len(sources))).astype(float)
        return columns / np.sqrt(columns.sum(axis=0))

    def _with_drift(self, basis: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Return the basis with slow cosines of level and slope, where the residuals drift."""
        if not self._ordered:
            return basis
        means = np.add.reduceat(residual(left, basis), self._starts) / self._lengths[:, None]
        count = num_cosines(means, self._lengths / self._lengths.mean())
        if not count:
            return basis
        slow = cosines(len(means), count)[self._owner]
        drift = residual(np.hstack([slow, slow * self._step[:, None]]), basis)
        columns, sizes, _ = np.linalg.svd(drift, full_matrices=False)
        return np.hstack([basis, columns[:, sizes > 1e-6 * sizes[0]]])

    def _gaussians(self, points):
        distances = squared_distances(points, points[self._functions])
        return np.exp(distances / (-2 * points.shape[1]))

    def _bumps(self, own, of_given):
        """Return Gaussians of what the sensor has for itself and of what is given: (N, k)."""
        of_sensor = self._gaussians(own)
        of_sensor -= of_sensor.mean(axis=0)  # no function of the given channels alone
        return np.hstack([of_sensor * of_given, own])

    def _cyclic_shifts(self) -> np.ndarray:
        """Return the row whose residual each row has in each shift, shape (shifts, N).

        An episode takes the residuals, step by step, from those so many episodes later that are as
        long; where a source has its own mean, of the same source.
        """
        rank_in_order = np.empty_like(self._order)
        rank_in_order[self._order] = np.arange(len(self._order))
        sources = np.unique(self._sources, return_inverse=True)[1][self._owner]
        place = np.arange(len(self._owner)) - self._starts[self._owner]
        order = np.lexsort((rank_in_order[self._owner], place, sources))
        cells = np.unique(np.column_stack([sources, place]), axis=0, return_inverse=True)[1]
        cells = cells.ravel()
        counts = np.bincount(cells)
        first = (np.cumsum(counts) - counts)[cells]
        rank = np.empty(len(order), dtype=int)
        rank[order] = np.arange(len(order))
        count, rank = counts[cells], rank - first
        num_episodes = len(self._order)
        num_shifts = min(_MAX_SHIFTS, num_episodes - 1)
        by = np.linspace(1, num_episodes - 1, num_shifts).round() / num_episodes
        return np.array(
            [order[first + (rank + np.round(share * count).astype(int)) % count] for share in by]
        )


class _Products:
    """Products of residuals (N, q), orthogonal to a basis (N, r), with functions of a sensor."""

    def __init__(self, left, basis, starts, shifts, level):
        lengths = np.diff(starts, append=len(left))
        # Between the number of steps and its root grows the deviation of an episode's sum.
        weights = np.repeat(np.sqrt(lengths.mean() / lengths), lengths)[:, None]
        self._left = left * weights
        self._errors = corrected_residual(left, basis, starts) * weights
        self._basis = basis
        self._in_basis = basis.T @ self._left
        self._basis_products = _sums_of_products(basis, self._errors, starts)
        self._starts, self._shifts, self._level = starts, shifts, level

    def pvalue(self, families: Sequence[np.ndarray]) -> float:
        """Return the p-value of functions (N, k) in families, each of which is whitened."""
        signs, prepared = [], []
        for functions in families:
            coefficients = self._basis.T @ functions
            gram = (functions.T @ functions - coefficients.T @ coefficients) / len(functions)
            variances, axes = np.linalg.eigh(gram)
            kept = variances > 1e-9 * variances[-1]
            variances, axes = variances[kept], axes[:, kept]
            weights = 1 / (variances[:, None] + variances[-1] * _WHITENINGS)
            total = axes.T @ (functions.T @ self._left - coefficients.T @ self._in_basis)
            statistics = (total**2).T @ weights
            products = _sums_of_products(functions, self._errors, self._starts)
            products = (products - self._basis_products @ coefficients) @ axes
            signs += [
                sign_flip_pvalue(statistics[q, w], products[:, q] * np.sqrt(weights[:, w]))
                for q, w in np.ndindex(statistics.shape)
            ]
            prepared.append((functions, coefficients, axes, weights, statistics))
        pvalue = combined_pvalue(signs)
        return max(pvalue, self._by_shifts(prepared)) if pvalue <= self._level else pvalue

    def _by_shifts(self, prepared) -> float:
        pvalues: list[float] = []
        for functions, coefficients, axes, weights, statistics in prepared:
            left = functions @ axes - self._basis @ (coefficients @ axes)
            for errors, observed in zip(self._errors.T, statistics, strict=True):
                drawn = (errors[self._shifts] @ left) ** 2 @ weights
                pvalues += resampled_pvalues(observed, drawn)
        return combined_pvalue(pvalues)


@njit(cache=True, nogil=True, fastmath={'contract', 'reassoc', 'nsz', 'arcp'})
def _sums_of_products(functions, residuals, starts):
    """Return the sums over each episode of residuals (N, q) times functions (N, k): (M, q, k)."""
    sums = np.zeros((len(starts), residuals.shape[1], functions.shape[1]))
    episode = -1
    for row in range(len(functions)):
        if episode + 1 < len(starts) and starts[episode + 1] == row:
            episode += 1
        for q in range(residuals.shape[1]):
            value = residuals[row, q]
            for k in range(functions.shape[1]):
                sums[episode, q, k] += value * functions[row, k]
    return sums


def _pooled(sources: np.ndarray) -> np.ndarray:
    """Return the sources; those of a single episode, which has nothing beside it, are one."""
    names, which, counts = np.unique(sources, return_inverse=True, return_counts=True)
    return np.where(counts[which] > 1, names[which], '')


def _polynomials(own, given):
    """Return products of what the sensor has for itself with itself and the given: (N, k)."""
    squares = [own[:, [i]] * own[:, i:] for i in range(own.shape[1])]
    with_given = [own[:, [i]] * given for i in range(own.shape[1])]
    return np.hstack([own, *with_given, *[square - square.mean(axis=0) for square in squares]])
