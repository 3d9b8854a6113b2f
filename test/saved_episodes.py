# SPDX-License-Identifier: Apache-2.0

"""What tests of the file of episodes have in common."""

import time

import numpy as np
from selections import selection, sensor

from cmifs_ros.core import Episode

NAMES = ('a', 'b')
SELECTION = selection(
    sensor('b', is_selected=True, pvalue=0.01, status='confirmed', stability=1.0),
    sensor('a', pvalue=0.8, status='dispensable', redundant_with=('b',)),
    means=(0.0, 1.0, 2.0),
    spreads=(1.0, 1.0, 1.0),
    number=7,
)
ENOUGH = {'max_episodes': 100, 'max_bytes': 10**6}


def episodes(count=3, steps=4):
    return [
        Episode(np.full((steps, 2), float(n)), np.arange(float(steps)) + n) for n in range(count)
    ]


def same(one, other):
    return np.array_equal(one.states, other.states) and np.array_equal(one.rewards, other.rewards)


def wait_until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)
