"""Conditional mutual information between return and features, given the time step."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .episode import Episode
from .lsmi import Lsmi
from .samples import StepSamples, step_samples


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
        self._steps = step_samples(
            episodes,
            gamma=gamma,
            standardize=standardize,
            max_time_bins=max_time_bins,
            num_folds=estimator.num_folds,
            num_centers=estimator.num_centers,
            random_state=random_state,
        )

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Return one score for each subset of channel indices: shape (len(subsets),)."""

        def score_step(step: StepSamples) -> np.ndarray:
            if step.folds.max() == 0:
                return np.zeros(len(subsets))
            features = [step.states[:, list(subset)] for subset in subsets]
            return self._estimator.estimate(step.returns, features, step.folds, step.centers)

        with ThreadPoolExecutor(self._n_jobs) as pool:
            scores = list(pool.map(score_step, self._steps))
        return np.average(scores, axis=0, weights=[len(step.returns) for step in self._steps])
