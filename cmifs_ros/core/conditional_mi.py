"""Conditional mutual information between return and features, given the time step."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .episode import Episode
from .held_out import TOLERANCE
from .lsmi import Lsmi
from .samples import step_samples
from .workspace import Workspace


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
    n_jobs : int
        Threads that share the steps.

    """

    def __init__(
        self,
        episodes: Sequence[Episode],
        estimator: Lsmi,
        *,
        gamma: float,
        standardize: bool,
        max_time_bins: int | None,
        random_state: int,
        n_jobs: int,
    ):
        self._estimator = estimator
        self._n_jobs = n_jobs
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

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Score subsets of channel indices.

        Returns
        -------
        numpy.ndarray, shape (len(subsets),)
            The greatest is exact. A smaller one, known to be smaller, may have been left at
            its float32 value.

        """
        workspace = Workspace()
        estimator = self._estimator
        with ThreadPoolExecutor(self._n_jobs) as pool:
            screened = list(
                pool.map(lambda step: estimator.screen(step, subsets, workspace), self._steps)
            )
            scores = self._weights @ np.array([values for values, _ in screened])
            if estimator.criterion == 'held_out':
                contenders = np.flatnonzero(scores >= scores.max() - 2 * TOLERANCE)
            else:  # The screening speaks of Equation (7), not of Equation (10).
                contenders = np.arange(len(subsets))
            chosen = [subsets[i] for i in contenders]
            exact = pool.map(
                lambda step, result: estimator.refine(
                    step, chosen, result[1][contenders], workspace
                ),
                self._steps,
                screened,
            )
            scores[contenders] = self._weights @ np.array(list(exact))
        return scores
