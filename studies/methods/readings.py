# SPDX-License-Identifier: Apache-2.0

"""Alternative readings of what the paper leaves open, as methods to compare with.

docs/reproduction.md describes what each of them changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from cmifs_ros.core import ConditionalMI, Episode, Lsmi
from cmifs_ros.core.kdr import REGULARIZATION, centred_gram, median_distance
from cmifs_ros.core.samples import step_samples
from cmifs_ros.core.search import Criterion, forward_selection


class ProgramLsmi(Lsmi):
    """LSMI with the last line of the authors' MATLAB program, h'alpha / 2 - 1 / 2."""

    def information(self, step, subsets, objective, points):
        """Return the program's estimate at given points of the grid."""
        width, regularization = np.unravel_index(points, objective.shape[1:])
        values = []
        for subset, w, i in zip(subsets, width, regularization, strict=True):
            k_eta, k_z = (
                np.exp(cdist(data[step.centers], data, 'sqeuclidean') / (-2 * self.widths[w] ** 2))
                for data in (step.returns[:, None], step.states[:, list(subset)])
            )
            matrix = (k_eta @ k_eta.T) * (k_z @ k_z.T) / len(step.returns) ** 2
            h = np.mean(k_eta * k_z, axis=1)
            regularized = matrix + self.regularizations[i] * np.eye(len(h))
            values.append(h @ np.linalg.solve(regularized, h) / 2 - 0.5)
        return np.array(values)


@dataclass(frozen=True)
class Estimate:
    """Conditional MI as in `ConditionalMISelector.paper()`, except for scale and estimator."""

    estimator: Lsmi
    standardize: bool

    def criterion(self, episodes: Sequence[Episode], target: Sequence[int], seed: int) -> Criterion:
        """Return the criterion of these episodes."""
        steps = step_samples(
            episodes,
            gamma=0.95,
            standardize=self.standardize,
            max_time_bins=None,
            num_folds=self.estimator.num_folds,
            num_centers=self.estimator.num_centers,
            random_state=seed,
        )
        return ConditionalMI(steps, self.estimator, tuning_window=0)


@dataclass(frozen=True)
class ReadKDR:
    """KDR with a width for each set of channels, or with eps times the number of samples."""

    own_widths: bool
    scaled: bool

    def criterion(self, episodes: Sequence[Episode], target: Sequence[int], seed: int) -> Criterion:
        """Return the criterion of these episodes, all of the same length."""
        states = np.stack([episode.states for episode in episodes])

        def width(channels):
            samples = states[:, :, channels] if self.own_widths else states
            return median_distance(samples.reshape(-1, samples.shape[2]), seed)

        def unexplained(subset):
            subset, goal = list(subset), list(target)
            eps = REGULARIZATION * (len(states) if self.scaled else 1)
            widths = width(subset), width(goal)
            total = 0.0
            for n in range(states.shape[1] - 1):
                now = centred_gram(states[:, n, subset], widths[0])
                later = centred_gram(states[:, n + 1, goal], widths[1])
                total += np.trace(np.linalg.solve(now + eps * np.eye(len(now)), later))
            return total

        return lambda subsets: np.array([-unexplained(subset) for subset in subsets])


_PAPER = Lsmi('plug_in', num_centers=None)
_HELD_OUT = Lsmi('held_out', num_centers=None)
#: The name of each reading, and a function that makes its criterion.
READINGS: dict[str, Estimate | ReadKDR] = {
    'paper_standardized': Estimate(_PAPER, standardize=True),
    'paper_program': Estimate(ProgramLsmi('plug_in', num_centers=None), standardize=False),
    'paper_held_out': Estimate(_HELD_OUT, standardize=False),
    'paper_held_out_standardized': Estimate(_HELD_OUT, standardize=True),
    'kdr_own_widths': ReadKDR(own_widths=True, scaled=False),
    'kdr_scaled': ReadKDR(own_widths=False, scaled=True),
}


def rank_read(
    name: str, episodes: Sequence[Episode], target: Sequence[int], seed: int, num_features: int
) -> tuple[list[int], list[float]]:
    """Rank channels by forward selection with one of `READINGS`."""
    criterion = READINGS[name].criterion(episodes, target, seed)
    sensors = [(channel,) for channel in range(episodes[0].num_channels)]
    return forward_selection(criterion, sensors, num_features)
