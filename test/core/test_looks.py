# SPDX-License-Identifier: Apache-2.0

"""The level of many looks: what they spend together."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core.looks import level_of_look

SIGNIFICANCE = 0.05


def test_the_first_look_has_the_most_and_later_ones_ever_less():
    levels = [level_of_look(SIGNIFICANCE, n, 20, 400) for n in range(20, 5000, 7)]
    assert np.all(np.diff(levels) < 0)
    assert 0 < levels[-1] < levels[0] < SIGNIFICANCE


def test_looks_at_all_doublings_and_renewals_spend_no_more_than_the_whole():
    doublings = [20 * 2**k for k in range(5)]
    renewals = [320 + 320 * k for k in range(1, 5000)]
    spent = sum(level_of_look(SIGNIFICANCE, n, 20, 320) for n in doublings + renewals)
    assert spent <= SIGNIFICANCE


@given(st.integers(1, 10**7), st.integers(1, 1000), st.integers(1, 10**5), st.floats(0.001, 0.5))
def test_any_look_has_a_part_of_the_level(num_seen, num_first, buffer_size, significance):
    assert 0 < level_of_look(significance, num_seen, num_first, buffer_size) < significance
