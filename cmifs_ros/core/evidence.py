"""Tests whether a sensor tells something about the return that the others selected do not.

The score with the sensor is compared with the scores with its shadows in its place. Their mean
comes from local shadows, which keep what the sensor shares with the others selected; the spread of
whole trajectories of other episodes is theirs, since the steps of an episode are not independent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from .samples import Samples
from .search import Criterion
from .shadows import local_shadows, whole_shadows

#: Shadows of each kind, and local ones after which a hopeless test ends.
_NUM_SHADOWS = 15
_NUM_FIRST = 3
#: Least spread: differences of a score that are no greater tell nothing worth a sensor.
_LEAST_SPREAD = 2e-3


class Evidence(NamedTuple):
    """What a test of one sensor, given others, found.

    Attributes
    ----------
    score : float
        The criterion of the given channels and the sensor's.
    null_scores : tuple of (float, float, float)
        The same for a sensor that tells nothing: 5 %, median, 95 %.
    pvalue : float
        Of one test; nothing is corrected for the choice among many.

    """

    score: float
    null_scores: tuple[float, float, float]
    pvalue: float


class ConditionalTest:
    """Test channels given others.

    Parameters
    ----------
    samples : Samples
    make_criterion : callable
        Gives the criterion of samples.
    random_state : int
        Seed of the shadows.

    """

    def __init__(
        self,
        samples: Samples,
        make_criterion: Callable[[Samples], Criterion],
        random_state: int,
    ):
        self._samples = samples
        self._make_criterion = make_criterion
        self._random_state = random_state
        self._known: dict[tuple, Evidence] = {}

    def __call__(
        self, channels: Sequence[int], given: Sequence[int], *, in_full: bool = False
    ) -> Evidence:
        """Test channels given others; unless in full, a hopeless test ends early."""
        key = tuple(channels), frozenset(given), in_full
        if key not in self._known:
            self._known[key] = self._test(list(channels), list(given), in_full)
        return self._known[key]

    def _test(self, channels: list[int], given: list[int], in_full: bool) -> Evidence:
        rng = np.random.default_rng([self._random_state, 1, len(given)])
        local = local_shadows(self._samples, channels, given, _NUM_SHADOWS, rng)
        first = self._scores(channels, given, local[:_NUM_FIRST])
        if not in_full and first[0] <= first[1:].max():
            return _evidence(first[0], first[1:], np.std(first[1:]))
        rest = self._scores(channels, given, local[_NUM_FIRST:])[1:]
        whole = whole_shadows(self._samples, channels, _NUM_SHADOWS, rng)
        spread = np.std(self._scores(channels, given, whole)[1:], ddof=1)
        return _evidence(first[0], np.concatenate([first[1:], rest]), spread)

    def _scores(self, channels, given, shadows) -> np.ndarray:
        """Return the score of the channels and of each shadow, with those given."""
        own = self._samples.states[:, [*given, *channels]]
        count, num_rows, width = shadows.shape
        columns = shadows.transpose(1, 0, 2).reshape(num_rows, -1)
        base = list(range(len(given)))
        extended = Samples(
            self._samples.returns,
            np.hstack([own, columns]),
            self._samples.owner,
            self._samples.step,
        )
        subsets = [
            [*base, *range(len(given) + i * width, len(given) + (i + 1) * width)]
            for i in range(count + 1)
        ]
        return self._make_criterion(extended)(subsets)


def _evidence(score: float, null: np.ndarray, spread: float) -> Evidence:
    """Return the evidence by a Gumbel law: the scores of what tells nothing lean to the right."""
    mean = float(np.mean(null))
    spread = float(max(spread, np.std(null), _LEAST_SPREAD)) * np.sqrt(1 + 1 / len(null))
    scale = spread / stats.gumbel_r.std()
    law = stats.gumbel_r(mean - stats.gumbel_r.mean() * scale, scale)
    null_scores = tuple(float(law.ppf(q)) for q in (0.05, 0.5, 0.95))
    return Evidence(float(score), null_scores, float(law.sf(score)))
