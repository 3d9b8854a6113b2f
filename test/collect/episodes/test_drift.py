# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from cmifs_ros.collect.episodes.drift import Drift
from cmifs_ros.core import Episode
from cmifs_ros.core.selecting import select


def episodes(count, seed=0, scale=(1.0, 1.0, 0.0), offset=(0.0, 1e9, 3.0)):
    """Return episodes of three channels: normal, normal far from 0, constant."""
    states = np.random.default_rng(seed).normal(size=(count, 10, 3)) * scale + offset
    return [Episode(s, s[:, 0]) for s in states]


@pytest.fixture(scope='module')
def selection():
    return select(episodes(30), ('a', 'b', 'c'), 'conditional_mi', {'num_features': 1})


def changed(selection, new):
    drift = Drift(selection, horizon=20)
    for episode in new:
        drift.add(episode)
    return drift.changed()


@pytest.mark.parametrize('seed', range(1, 6))
def test_the_same_again_is_no_change(selection, seed):
    assert changed(selection, episodes(200, seed)) == []


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        ({'offset': (2.0, 1e9, 3.0)}, [0, 3]),  # the reward is channel 0
        ({'offset': (0.0, 1e9 + 2, 3.0)}, [1]),
        ({'offset': (0.0, 1e9, 3.001)}, [2]),
        ({'scale': (1.0, 5.0, 0.0)}, [1]),
        ({'offset': (1e308, 1e9, 3.0)}, [0, 3]),
    ],
)
def test_what_moved_or_spread_is_named_however_long_it_was_quiet(selection, change, expected):
    assert changed(selection, episodes(1000, 1) + episodes(30, 2, **change)) == expected


def test_nothing_is_said_of_a_few_episodes_or_of_other_channels(selection):
    assert changed(selection, episodes(19, offset=(9.0, 9.0, 9.0))) == []
    assert changed(selection, [Episode(np.full((5, 2), 99.0), np.zeros(5))] * 50) == []


@pytest.mark.parametrize('kind', ['line', 'walk'])
def test_what_drifts_as_it_did_is_no_change_but_a_jump_is(kind):
    rng = np.random.default_rng(3)
    level = -np.arange(160) / 100 if kind == 'line' else np.cumsum(rng.normal(size=160))
    states = np.stack([np.tile(level[:, None], 10), rng.normal(size=(160, 10))], axis=2)
    drive = [Episode(s, s[:, 1]) for s in states]
    chosen = select(drive[:100], ('level', 'b'), 'conditional_mi', {'num_features': 1})
    assert changed(chosen, drive[100:]) == []
    jump = 5 * np.ptp(level[:100]) * np.array([1.0, 0.0])
    assert changed(chosen, [Episode(s + jump, s[:, 1]) for s in states[100:]]) == [0]
