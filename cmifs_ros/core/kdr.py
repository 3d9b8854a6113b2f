# SPDX-License-Identifier: Apache-2.0

"""Kernel dimension reduction (KDR) as a criterion: the paper's baseline, one step ahead.

Section 4.1 of Hachiya & Sugiyama (2010), after Fukumizu, Bach & Jordan, Kernel dimension
reduction in regression (2009): a subset Z of the state is good if the target channels Y at the
next step are independent of the whole state given Z. In terms of centred Gram matrices, a good
subset has a small Tr[Kc_Y (Kc_Z + eps I)^-1].
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist, pdist

from .episode import Episode

#: The regularisation eps as printed, not multiplied by the number of samples.
REGULARIZATION = 0.1

#: Greatest number of samples used for the width: two million distances, 16 MB.
_WIDTH_SAMPLES = 2000


class KDR:
    """Score channel subsets by how well they explain the target channels one step later.

    The score is -sum_n Tr[Kc_Y (Kc_Z + eps I)^-1] relative to the empty subset, which scores 0. Y
    is the target at step n + 1, Z the subset at step n, and the sum is over all steps. A step uses
    the episodes that reach the next step; a step with fewer than two of them counts as 0.

    Y and every Z share one Gaussian width: the median distance between all samples of all steps and
    episodes, over all channels in their own units. The paper speaks of 'the width' and 'all the
    data samples'; read this way, its Figure 6(a) is reproduced.

    Parameters
    ----------
    episodes : sequence of Episode
    target : sequence of int
        The channels that the reward depends on directly.
    random_state : int
        Seed of the subset of samples used for the width if there are more than 2000.

    Raises
    ------
    ValueError
        If fewer than two episodes have a second step.

    """

    def __init__(self, episodes: Sequence[Episode], target: Sequence[int], *, random_state: int):
        num_steps = sorted(map(len, episodes))[-2] - 1 if len(episodes) > 1 else 0
        if num_steps < 1:
            raise ValueError(
                f'the {len(episodes)} episodes have {[len(e) for e in episodes]} steps; expected '
                'at least two episodes of 2 or more steps, because KDR looks one step ahead'
            )
        samples = np.concatenate([episode.states for episode in episodes])
        self._width = median_distance(samples, random_state)
        self._steps = []
        for n in range(num_steps):
            present = [episode.states for episode in episodes if len(episode) > n + 1]
            later = np.stack([states[n + 1, list(target)] for states in present])
            now = np.stack([states[n] for states in present])
            self._steps.append((now, centred_gram(later, self._width)))

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Return one score for each subset of channel indices: shape (len(subsets),)."""
        return np.array([self._score(list(subset)) for subset in subsets])

    def _score(self, subset: list[int]) -> float:
        score = 0.0
        for now, later_gram in self._steps:
            gram = centred_gram(now[:, subset], self._width)
            regularized = gram + REGULARIZATION * np.eye(len(gram))
            unexplained = cho_solve(cho_factor(regularized, lower=True), later_gram)
            score += np.trace(later_gram) / REGULARIZATION - np.trace(unexplained)
        return score


def median_distance(samples: np.ndarray, random_state: int) -> float:
    """Return the median Euclidean distance between samples (M, v), or between 2000 of them.

    If more than half of the distances are 0, it is the median of the positive ones. If all are 0,
    it is 1; any positive number would do.
    """
    if len(samples) > _WIDTH_SAMPLES:
        rng = np.random.default_rng(random_state)
        samples = samples[rng.choice(len(samples), _WIDTH_SAMPLES, replace=False)]
    distances = pdist(samples)
    positive = distances[distances > 0]
    if positive.size == 0:
        return 1.0
    return float(np.median(distances) or np.median(positive))


def centred_gram(samples: np.ndarray, width: float) -> np.ndarray:
    """Return H K H for the Gaussian Gram matrix K of samples (M, u) and H = I - 1 1' / M."""
    gram = np.exp(cdist(samples, samples, 'sqeuclidean') * (-0.5 / width**2))
    gram -= gram.mean(axis=0)
    gram -= gram.mean(axis=1, keepdims=True)
    return gram
