# SPDX-License-Identifier: Apache-2.0

"""Conditional mutual information between return and channels, given the time step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .lsmi import Lsmi
from .samples import StepSamples
from .threads import in_threads


class ConditionalMI:
    """Score channel subsets by I(eta; z | n) = sum_n p(n) I(eta_n; z_n).

    p(n) is the share of all samples observed at step n; with episodes of equal length this is
    Equation (9) of Hachiya & Sugiyama (2010). A step that only one episode reaches shows no
    dependence and counts as 0.

    Parameters
    ----------
    steps : sequence of StepSamples
        The samples of each step, from `split_by_step`.
    estimator : Lsmi
    tuning_window : int
        Each step chooses its width and regularisation by the held-out objective, averaged over
        the step and this many steps on either side with linearly decreasing weights. With few
        episodes this stabilises the choice; 0 is the paper's.
    n_jobs : int
        Number of threads; the compiled part releases the interpreter lock.

    """

    def __init__(
        self,
        steps: Sequence[StepSamples],
        estimator: Lsmi,
        *,
        tuning_window: int,
        n_jobs: int = 1,
    ):
        self._estimator = estimator
        self._n_jobs = n_jobs
        total = sum(len(step.returns) for step in steps)
        self._steps = [step for step in steps if step.folds.max() > 0]
        self._weights = np.array([len(step.returns) / total for step in self._steps])
        index = np.arange(len(self._steps))
        nearness = np.maximum(0, tuning_window + 1 - abs(index[:, None] - index))
        self._window = nearness * self._weights
        self._window /= self._window.sum(axis=1, keepdims=True)
        self._known: dict[tuple[int, ...], float] = {}

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Score subsets of channel indices: shape (len(subsets),). Results are cached."""
        keys = [tuple(sorted(subset)) for subset in subsets]
        new = [key for key in dict.fromkeys(keys) if key not in self._known]
        if new:
            scores = self._weights @ self.by_step(new) if self._steps else np.zeros(len(new))
            self._known.update(zip(new, scores.tolist(), strict=True))
        return np.array([self._known[key] for key in keys])

    def by_step(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Score subsets at each step: shape (steps, len(subsets))."""
        # One job per step; with few steps, one job per step and part of the subsets.
        parts = min(len(subsets), -(-2 * self._n_jobs // len(self._steps)))
        chunks = np.array_split(np.arange(len(subsets)), parts if self._n_jobs > 1 else 1)
        jobs = [(step, [subsets[i] for i in chunk]) for step in self._steps for chunk in chunks]

        done = in_threads(lambda job: self._estimator.objective(*job), jobs, self._n_jobs)
        n = len(chunks)
        exact = np.stack([np.concatenate(done[i : i + n]) for i in range(0, len(done), n)])
        averaged = np.tensordot(self._window, exact, axes=1)
        picked = averaged.reshape(*averaged.shape[:2], -1).argmin(axis=2)
        return np.array(
            [
                self._estimator.information(step, subsets, of_step, points)
                for step, of_step, points in zip(self._steps, exact, picked, strict=True)
            ]
        )
