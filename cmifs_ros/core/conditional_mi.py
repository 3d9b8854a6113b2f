"""Conditional mutual information between return and features, given the time step."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from itertools import repeat

import numpy as np

from .episode import Episode
from .held_out import TOLERANCE
from .lsmi import Lsmi
from .samples import step_samples


class ConditionalMI:
    """Score channel subsets by I(eta; z | n) = sum_n p(n) I(eta_n; z_n).

    p(n) is the share of all samples observed at step n; with episodes of equal length this is
    Equation (9) of Hachiya & Sugiyama (2010). A step that a single episode reaches tells
    nothing of dependence and counts as 0.

    Parameters
    ----------
    episodes : sequence of Episode
    estimator : Lsmi
    gamma, standardize, max_time_bins, random_state
        As of `step_samples`.
    tuning_window : int
        Each step picks its width and regularisation by the held-out objective averaged over
        its samples and those of so many steps on either side, with weights that fall linearly.
        With few episodes that steadies the choice; 0 is the paper's.
    executor : concurrent.futures.Executor, optional
        Shares the steps among its processes; None does them one after the other.

    """

    def __init__(
        self,
        episodes: Sequence[Episode],
        estimator: Lsmi,
        *,
        gamma: float,
        standardize: bool,
        max_time_bins: int | None,
        tuning_window: int,
        random_state: int,
        executor: Executor | None,
    ):
        self._estimator = estimator
        self._map = map if executor is None else executor.map
        steps = step_samples(
            episodes,
            gamma=gamma,
            standardize=standardize,
            max_time_bins=max_time_bins,
            num_folds=estimator.num_folds,
            num_centers=estimator.num_centers,
            random_state=random_state,
        )
        total = sum(len(step.returns) for step in steps)
        self._steps = [step for step in steps if step.folds.max() > 0]
        self._weights = np.array([len(step.returns) / total for step in self._steps])
        index = np.arange(len(self._steps))
        nearness = np.maximum(0, tuning_window + 1 - abs(index[:, None] - index))
        self._window = nearness * self._weights
        self._window /= self._window.sum(axis=1, keepdims=True)

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Score subsets of channel indices.

        Returns
        -------
        numpy.ndarray, shape (len(subsets),)
            The greatest is exact. A smaller one, known to be smaller, may have been left at
            its float32 value.

        """
        estimator = self._estimator

        def objective(subsets, which):
            return np.array(
                list(self._map(estimator.objective, self._steps, repeat(subsets), which))
            )

        screened = objective(subsets, repeat(None))
        averaged = np.tensordot(self._window, screened, axes=1)
        best = averaged.min(axis=(2, 3), keepdims=True)
        points = averaged <= best + TOLERANCE
        scores = -2 * screened - 1
        least = self._weights @ np.where(points, scores, np.inf).min(axis=(2, 3))
        greatest = self._weights @ np.where(points, scores, -np.inf).max(axis=(2, 3))
        if estimator.criterion == 'held_out':
            contenders = np.flatnonzero(greatest >= least.max() - 2 * TOLERANCE)
        else:  # The screening speaks of Equation (7), not of Equation (10).
            contenders = np.arange(len(subsets))

        # In float64: what the scores are made of, and what decides between several points.
        points, chosen = points[:, contenders], [subsets[i] for i in contenders]
        widths = points.any(axis=3)
        undecided = points.sum(axis=(2, 3), keepdims=True)[..., 0] > 1
        which = np.tensordot(self._window > 0, widths & undecided, axes=1) > 0
        if estimator.criterion == 'held_out':
            which |= widths
        exact = objective(chosen, which)
        averaged = np.where(points, np.tensordot(self._window, exact, axes=1), np.inf)
        picked = averaged.reshape(*averaged.shape[:2], -1).argmin(axis=2)
        information = self._map(estimator.information, self._steps, repeat(chosen), exact, picked)
        scores = greatest
        scores[contenders] = self._weights @ np.array(list(information))
        return scores
