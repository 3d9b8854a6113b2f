# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from std_msgs.msg import Header

from cmifs_ros.ros import conversions


@pytest.mark.parametrize('nanoseconds', [0, 1, 999_999_999, 1_000_000_000, 2**62 // 10**9 * 10**9])
def test_stamps_survive_the_round_trip(nanoseconds):
    nanoseconds = min(nanoseconds, (2**31 - 1) * 10**9)
    stamp = conversions.stamp_from_nanoseconds(nanoseconds)
    assert conversions.stamp_to_nanoseconds(stamp) == nanoseconds


def test_the_map_has_column_and_row_as_x_and_y():
    walls = np.zeros((3, 2), dtype=bool)
    gravel = np.zeros((3, 2), dtype=bool)
    walls[2, 0] = gravel[0, 1] = True
    grid = conversions.grid_to_msg(Header(), walls, gravel)
    assert (grid.info.width, grid.info.height) == (3, 2)
    assert list(grid.data) == [0, 0, 100, 50, 0, 0]
