# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core import discounted_returns


@given(
    rewards=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40),
    gamma=st.floats(0.01, 1),
)
def test_returns_are_the_discounted_sums_of_their_definition(rewards, gamma):
    expected = [
        sum(gamma ** (later - t) * rewards[later] for later in range(t, len(rewards)))
        for t in range(len(rewards))
    ]
    np.testing.assert_allclose(discounted_returns(rewards, gamma), expected, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize('gamma', [0, -0.5, 1.01, np.nan])
def test_gamma_outside_its_range_is_refused(gamma):
    with pytest.raises(ValueError, match='gamma is'):
        discounted_returns([1.0], gamma)
