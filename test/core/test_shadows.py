# SPDX-License-Identifier: Apache-2.0

"""The null band, from scores whose law is known."""

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.samples import collect_samples
from cmifs_ros.core.shadows import null_scores


def test_nine_of_ten_further_shadows_lie_within_the_null_band():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(4, 2, 3))
    samples = collect_samples([Episode(s, [0.0, 1.0]) for s in states], gamma=1, standardize=True)
    num_places = 20_000

    def criterion(subsets):
        return 2.0 + 0.5 * rng.normal(size=len(list(subsets)))

    low, median, high = null_scores(
        lambda samples: criterion, samples, [0, 1, 2], [[]] * num_places, rng
    ).T
    further = 2.0 + 0.5 * rng.normal(size=num_places)
    assert abs(np.mean(further < low) - 0.05) < 0.006  # four standard errors
    assert abs(np.mean(further > high) - 0.05) < 0.006
    assert abs(np.mean(median) - 2.0) < 0.01
