# SPDX-License-Identifier: Apache-2.0

"""Laser scans by angle."""

import math
from array import array
from types import SimpleNamespace as Message

import numpy as np
import pytest

from cmifs_ros.collect.encoders import Scan


def scan_of(ranges, first, increment):
    return Message(
        ranges=array('f', ranges), range_min=0.1, range_max=9.0,
        angle_min=math.radians(first), angle_increment=math.radians(increment),
    )  # fmt: skip


def test_each_sector_has_its_nearest_range():
    #  Rays at -50, -20, 10, ... degrees; sectors of 90 degrees around 0, 90, 180 and 270.
    message = scan_of([4.0, 3.0, 2.0, 5.0, 7.0, 6.0], -50, 30)
    assert Scan(num_sectors=4).encode(message) == [2.0, 6.0, 9.0, 4.0]
    assert Scan(num_sectors=4).suffixes == ('[0]', '[1]', '[2]', '[3]')


def test_what_is_no_reading():
    message = scan_of([math.nan, math.inf, -math.inf, 0.0, 50.0, 1.0], 0, 0)
    assert Scan(num_sectors=1).encode(message) == [pytest.approx(0.1)]  # -inf is too close
    message = scan_of([math.nan, math.inf, 0.05, 50.0], 0, 90)
    assert Scan(num_sectors=4).encode(message) == [9.0] * 4
    assert Scan().encode(scan_of([], 0, 1)) == [9.0] * 12


def test_the_number_of_rays_and_their_direction_do_not_matter():
    fine = np.full(720, 8.0)
    fine[40:50] = 1.5  # 20 to 24.5 degrees
    there = Scan().encode(scan_of(fine, 0, 0.5))
    assert there == [8.0, 1.5, *[8.0] * 10]
    assert Scan().encode(scan_of(fine[::2], 0, 1.0)) == there
    assert Scan().encode(scan_of(fine[::-1], 359.5, -0.5)) == there


def test_a_scan_without_angles_says_so():
    with pytest.raises(ValueError, match=r'a scan from nan in steps of 0\.0; expected'):
        Scan().encode(scan_of([1.0], math.nan, 0))
