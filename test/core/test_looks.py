# SPDX-License-Identifier: Apache-2.0

"""The level of many looks: what they spend together."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core.looks import level_of_look

SIGNIFICANCE = 0.05


def test_the_first_look_has_the_most_and_later_ones_ever_less():
    levels = [level_of_look(SIGNIFICANCE, r, 20) for r in np.arange(np.log2(20), 40, 0.1)]
    assert np.all(np.diff(levels) < 0)
    assert 0 < levels[-1] < levels[0] < SIGNIFICANCE


def test_looks_at_all_doublings_and_renewals_spend_no_more_than_the_whole():
    spent = sum(level_of_look(SIGNIFICANCE, np.log2(20) + k, 20) for k in range(5000))
    assert spent <= SIGNIFICANCE


def test_more_episodes_needed_for_a_first_look_spend_nothing():
    levels = {level_of_look(SIGNIFICANCE, np.log2(n), n) for n in (2, 20, 32, 1000)}
    assert len(levels) == 1
    assert level_of_look(SIGNIFICANCE, 0.0, 20) == levels.pop()


@given(st.floats(0, 10**7), st.integers(1, 10**5), st.floats(0.001, 0.5))
def test_any_look_has_a_part_of_the_level(renewals, num_first, significance):
    assert 0 < level_of_look(significance, renewals, num_first) < significance
