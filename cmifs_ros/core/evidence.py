"""Tests whether a sensor tells something about the return that the others selected do not.

A kernel test of conditional independence (Zhang, Peters, Janzing & Schoelkopf, Kernel-based
conditional independence test and application in causal discovery, 2011), made for episodes: what
the given channels and the time step explain is taken from the return and from functions of the
sensor, and the two remainders are multiplied. If the sensor tells nothing more, the products of an
episode sum up to either sign with equal chance, whatever the steps of it have to do with each
other (the wild cluster bootstrap: Cameron, Gelbach & Miller, Bootstrap-based improvements for
inference with clustered errors, 2008). What so seems to tell something has to do so once more,
where what is left of the return has changed places between the episodes. Neither is right by
itself: the signs of a few episodes that hold most of what is to be explained say too little of
chance, and places are not alike where the noise depends on what is given.

What is left of the return is looked at less all, and less a part, of what is left at the next step
(Sutton, Learning to predict by the methods of temporal differences, 1988): what the next steps add
has less noise than all that comes after. The functions are Gaussians, which see every shape, and
products with the given channels, which see few shapes but these from few episodes. Their p-values
are combined by their mean in the scale of a Cauchy variable, whatever they have to do with each
other (Liu & Xie, Cauchy combination test, 2020).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import linalg, special

from .kernel_ridge import KernelRidge, squared_distances
from .samples import Samples, standardized
from .serial_dependence import Episodes, Memory, innovations, memory_of

#: More rows are thinned evenly: neighbouring steps of an episode tell nearly the same.
_MAX_ROWS = 2000
_NUM_FOLDS = 5
#: Gaussians that explain the return by what is given, and those that are functions of the sensor.
_NUM_CENTERS, _NUM_FUNCTIONS = 50, 60
#: How far these functions are whitened: only the strongest, and all but the weakest, which few
#: episodes have to do with.
_WHITENINGS = np.array([1e-1, 1e-2])
#: Shares that are taken off what is left at a step of what is left at the next.
_SHARES_OF_NEXT = (0.6, 1.0)
_NUM_SIGNS, _NUM_EXCHANGES = 2000, 300
#: A p-value counts as no more beside others: one that is all but 1 would outweigh all of them.
_GREATEST = 0.95
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
        Seed of folds, centres, signs and exchanges.
    level : float
        p-value by signs up to which places are exchanged as well.
    may_drift : bool
        Free episodes of what they have of those before. Not where what is tested is their order.

    """

    def __init__(
        self,
        samples: Samples,
        gamma: float,
        random_state: int,
        *,
        level: float = 0.05,
        may_drift: bool = True,
    ):
        self._level = level
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
        self._may_drift = may_drift
        self._in_order = Episodes(self._step, self._starts)
        num_episodes = samples.owner[-1] + 1
        num_folds = min(_NUM_FOLDS, num_episodes)
        self._folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[owner]
        centers = rng.permutation(len(rows))
        self._centers, self._functions = centers[:_NUM_CENTERS], centers[:_NUM_FUNCTIONS]
        self._signs = rng.choice([-1.0, 1.0], size=(_NUM_SIGNS, len(self._episodes)))
        self._exchanges = self._exchanged(rng)
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
        remainders = [
            (self._differences(left, share), self._differences(errors, share))
            for share in _SHARES_OF_NEXT
        ]
        memories = self._in_order.memories(np.column_stack([e for _, e in remainders]))
        drifts = self._may_drift and any(map(any, memories))
        if drifts:
            both = np.column_stack([values for pair in remainders for values in pair])
            free = self._in_order.freed(both, memories).T
            remainders = list(zip(free[::2], free[1::2], strict=True))
        of_given = self._gaussians(points)
        channels = list(dict.fromkeys(c for candidate in candidates for c in candidate))
        fits = dict(zip(channels, regression.tuned(self._states[:, channels]), strict=True))
        pvalues = []
        for candidate in candidates:
            own = np.hstack([regression.residual(self._states[:, [c]], fits[c]) for c in candidate])
            own = self._in_order.without_slowest(own) if drifts else own
            own = own[:, own.var(axis=0) > _LEAST_OWN_SHARE]
            if own.size:
                own = own / own.std(axis=0)
                families = [_products(own, points), self._bumps(own, of_given)]
                whitened = [_whitened(regression.residual(f, choice)) for f in families]
                functions = np.hstack([functions for functions, _ in whitened])
                weights = linalg.block_diag(*[weights for _, weights in whitened])
                pvalues.append(self._pvalue(functions, weights, remainders))
            else:
                pvalues.append(1.0)
        return pvalues

    def _differences(self, residual, share):
        """Return residuals less a share of the discounted ones of the next row."""
        differences = residual.copy()
        for rows in self._episodes:
            differences[rows[:-1]] -= share * self._discount * residual[rows[1:]]
        return differences

    def _gaussians(self, points):
        distances = squared_distances(points, points[self._functions])
        return np.exp(distances / (-2 * points.shape[1]))

    def _bumps(self, own, of_given):
        """Return Gaussians of what the sensor has for itself and of what is given: (N, k)."""
        of_sensor = self._gaussians(own)
        of_sensor -= of_sensor.mean(axis=0)  # no function of the given channels alone
        return np.hstack([of_sensor * of_given, own])

    def _exchanged(self, rng):
        """Return the rows of which each row has the remainder in each exchange: (exchanges, N).

        The episodes stand in a random circle, and each takes what is left at its steps, or at those
        nearest where rows were thinned, from the next one that is as long.
        """
        lengths = [len(rows) for rows in self._episodes]
        owner = np.repeat(np.arange(len(lengths)), lengths)
        place = np.concatenate([np.arange(length) for length in lengths])
        circles = np.array([rng.permutation(len(lengths)) for _ in range(_NUM_EXCHANGES)])
        order = np.argsort(place * len(lengths) + circles[:, owner], axis=1)
        ends = np.cumsum(np.bincount(place))
        following = np.arange(1, len(place) + 1)
        following[ends - 1] = np.concatenate([[0], ends[:-1]])
        exchanged = np.empty_like(order)
        np.put_along_axis(exchanged, order, order[:, following], axis=1)
        return exchanged

    def _pvalue(self, functions: np.ndarray, weights: np.ndarray, remainders) -> float:
        """Return the probability that chance alone brings about products that large."""

        def combined(draw):
            tails = []
            for left, errors in remainders:
                observed, drawn = draw(left, errors)
                tails += _tails(observed**2 @ weights, drawn**2 @ weights)
            return combined_pvalue(tails)

        def of_episodes(residual):
            return np.add.reduceat(functions * residual[:, None], self._starts)

        def by_signs(left, errors):
            products, alike = of_episodes(errors), np.ones(len(self._starts))
            memory = memory_of(products, alike) if self._may_drift else Memory()
            observed = innovations(of_episodes(left), alike, memory).sum(axis=0)
            return observed, self._signs @ innovations(products, alike, memory)

        def by_places(left, errors):
            return left @ functions, left[self._exchanges] @ functions

        pvalue = combined(by_signs)
        return max(pvalue, combined(by_places)) if pvalue <= self._level else pvalue


def _products(own, given):
    """Return products of what the sensor has for itself with itself and the given: (N, k)."""
    squares = [own[:, [i]] * own[:, i:] for i in range(own.shape[1])]
    with_given = [own[:, [i]] * given for i in range(own.shape[1])]
    return np.hstack([own, *with_given, *[square - square.mean(axis=0) for square in squares]])


def _whitened(functions):
    """Return functions (N, k) along their principal axes, and the weights of their squares (k, s).

    Each statistic makes them alike as far as one of `_WHITENINGS` says.
    """
    variances, axes = np.linalg.eigh(functions.T @ functions / len(functions))
    weights = 1 / (np.maximum(variances, 0)[:, None] + variances.max() * _WHITENINGS)
    return functions @ axes, weights


def _tails(observed: np.ndarray, drawn: np.ndarray) -> list[float]:
    """Return the p-value of each statistic (s,), of which some were drawn by chance (n, s).

    The law has the three moments of those drawn (Winkler et al., Faster permutation inference in
    brain imaging, 2016). A statistic that chance leaves as it is has none.
    """
    means, spreads = drawn.mean(axis=0), drawn.std(axis=0)
    kept = spreads > 1e-12 * means
    scaled = (drawn[:, kept] - means[kept]) / spreads[kept]
    skewness = np.mean(scaled * scaled * scaled, axis=0)
    values = (observed - means)[kept] / spreads[kept]
    return [_pearson3_sf(value, skew) for value, skew in zip(values, skewness, strict=True)]


def combined_pvalue(pvalues: Sequence[float]) -> float:
    """Return the p-value of all of them, dependent as they may be; 1 of none."""
    if min(pvalues, default=1.0) > _GREATEST:
        return float(min(pvalues, default=1.0))
    mean = np.mean(1 / np.tan(np.pi * np.clip(pvalues, 1e-300, _GREATEST)))
    return float(np.arctan2(1, mean) / np.pi)


def _pearson3_sf(value: float, skewness: float) -> float:
    """Return scipy.stats.pearson3.sf(value, skewness); its module takes long to import."""
    if abs(skewness) < 1e-3:
        return float(special.ndtr(-value))
    shape = 4 / skewness**2
    drawn = max(shape + 2 * value / skewness, 0.0)
    tail = special.gammaincc if skewness > 0 else special.gammainc
    return float(tail(shape, drawn))
