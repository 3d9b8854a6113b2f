# SPDX-License-Identifier: Apache-2.0

"""The engine finds what the plain port of the authors' program finds, to the eighth decimal."""

import numpy as np
import pytest
from oracles import direct_lsmi

from cmifs_ros.core import ConditionalMI, Episode, Lsmi
from cmifs_ros.core.samples import StepSamples, step_samples
from cmifs_ros.core.search import forward_selection
from cmifs_ros.sim import rollout, rollout_chain
from studies.methods.direct_port import (
    REGULARIZATIONS,
    WIDTHS,
    conditional_mi,
    rank_directly,
)

RAW = {'standardize': False}


def episodes_of(lengths, make_states, make_rewards, seed=0):
    """Return one episode for each length; the functions get a generator and what they need."""
    rng = np.random.default_rng(seed)
    episodes = []
    for length in lengths:
        states = make_states(rng, length)
        episodes.append(Episode(states, make_rewards(rng, states)))
    return episodes


def normal(channels):
    return lambda rng, length: rng.normal(size=(length, channels))


def discrete(channels):
    return lambda rng, length: rng.integers(0, 3, size=(length, channels))


def product(rng, states):
    return states[:, 0] * states[:, 1] + 0.3 * rng.normal(size=len(states))


def first(rng, states):
    return states[:, 0]


def with_columns(make_states, change):
    def changed(rng, length):
        states = np.array(make_states(rng, length), dtype=float)
        change(states)
        return states

    return changed


def cut(episodes, steps, channels):
    """Return some steps and the first channels of each episode."""
    return [Episode(e.states[steps, :channels], e.rewards[steps]) for e in episodes]


def constant_second(states):
    states[:, 1] = 7.5


def constant_at_first(states):
    states[0, 1:] = 2


def copy_of_first(states):
    states[:, 2] = states[:, 0]


def far_away(states):
    states += 1000


def big_units(states):
    states *= [100, 0.01, 1]


def heavy_tails(states):
    states **= 3


RAGGED = (1, 2, 2, 3, 3, 4, 4, 4, 5, 5, 5, 6, 6, 6, 6)
#: Name: episodes, options of the selector.
DATA = {
    'grid world': (cut(rollout('without_gravel', 25, 1), slice(8, 12), 5), {}),
    'grid world, raw': (cut(rollout('without_gravel', 25, 2), slice(8, 12), 5), RAW),
    'gravel': (cut(rollout('with_gravel', 30, 3), slice(9, 12), 5), {}),
    'gravel, raw': (cut(rollout('with_gravel', 30, 4), slice(9, 12), 5), RAW),
    'chain': (rollout_chain(15, 5), {}),
    'chain, raw': (rollout_chain(15, 6), RAW),
    'chain, 40 episodes': (cut(rollout_chain(40, 7), slice(0, 2), 4), {}),
    'two episodes': (episodes_of([4] * 2, normal(4), product), {}),
    'three episodes, raw': (episodes_of([4] * 3, normal(4), first), RAW),
    'five episodes': (episodes_of([5] * 5, normal(4), product), {}),
    'one step': (episodes_of([1] * 30, normal(4), product), {}),
    'ties': (episodes_of([3] * 25, discrete(4), product), {}),
    'ties, raw': (episodes_of([3] * 25, discrete(4), first), RAW),
    'ties in all': (episodes_of([3] * 25, discrete(3), first), {'gamma': 1.0}),
    'zeros and ones': (
        episodes_of([3] * 20, lambda rng, n: rng.random((n, 4)) < 0.3, first), RAW
    ),
    'constant channel': (
        episodes_of([3] * 20, with_columns(normal(3), constant_second), first), {}
    ),
    'constant channel, ties': (
        episodes_of([3] * 20, with_columns(discrete(3), constant_second), first), RAW
    ),
    'constant at a step': (
        episodes_of([3] * 20, with_columns(normal(4), constant_at_first), product), {}
    ),
    'all channels constant': (
        episodes_of([3] * 12, lambda rng, n: np.ones((n, 3)), lambda rng, s: rng.normal(size=3)),
        {},
    ),
    'constant rewards': (episodes_of([3] * 12, normal(3), lambda rng, s: np.ones(3)), {}),
    'equal channels': (episodes_of([3] * 20, with_columns(normal(4), copy_of_first), product), {}),
    'unequal lengths': (episodes_of(RAGGED, normal(4), product), {}),
    'unequal lengths, ties, raw': (episodes_of(RAGGED, discrete(4), product), RAW),
    'last steps of one episode': (episodes_of([2] * 15 + [5], normal(3), product), {}),
    'time bins': (episodes_of([12] * 10, normal(3), product), {'max_time_bins': 3}),
    'time bins, unequal lengths': (
        episodes_of([5, 9, 12, 12, 7, 3, 12, 11], discrete(3), product), {'max_time_bins': 4}
    ),
    'few centres': (episodes_of([3] * 30, normal(4), product), {'num_centers': 11}),
    'few centres, ties': (episodes_of([3] * 30, discrete(4), product), {'num_centers': 11}),
    'groups': (episodes_of([3] * 20, normal(5), product), {'groups': {'b': [1, 4], 'a': [2, 3]}}),
    'far from 0, raw': (episodes_of([3] * 20, with_columns(normal(3), far_away), first), RAW),
    'different units, raw': (
        episodes_of([3] * 20, with_columns(normal(3), big_units), product), RAW
    ),
    'heavy tails': (episodes_of([3] * 20, with_columns(normal(3), heavy_tails), product), {}),
    'best two': (episodes_of([3] * 25, normal(5), product), {'num_features': 2}),
    'no discount': (episodes_of([4] * 20, normal(3), product), {'gamma': 1.0}),
    'each step by itself': (episodes_of([5] * 20, normal(4), product), {'tuning_window': 0}),
    'each step with all': (episodes_of(RAGGED, discrete(4), product), {'tuning_window': 9}),
    'other folds': (episodes_of([3] * 20, normal(3), product), {'random_state': 8}),
}  # fmt: skip
#: What `rank_directly` does unless told otherwise.
USUAL = {
    'gamma': 0.95,
    'standardize': True,
    'max_time_bins': 32,
    'tuning_window': 2,
    'num_centers': 200,
    'num_features': None,
    'random_state': 0,
}
#: The sensors of the data with groups, in the order of their first channels.
SENSORS = {'groups': [(0,), (1, 4), (2, 3)]}


@pytest.mark.parametrize('criterion', ['held_out', 'plug_in'])
@pytest.mark.parametrize('name', DATA)
def test_engine_and_port_give_the_same_ranking_and_scores(name, criterion):
    episodes, options = DATA[name]
    options = {key: value for key, value in options.items() if key != 'groups'}
    expected = rank_directly(episodes, criterion=criterion, sensors=SENSORS.get(name), **options)
    options = USUAL | options
    estimator = Lsmi(criterion, num_centers=options.pop('num_centers'))
    count, window = options.pop('num_features'), options.pop('tuning_window')
    steps = step_samples(
        episodes, num_folds=estimator.num_folds, num_centers=estimator.num_centers, **options
    )
    sensors = SENSORS.get(name) or [(i,) for i in range(episodes[0].num_channels)]
    ranking, scores = forward_selection(
        ConditionalMI(steps, estimator, tuning_window=window), sensors, count or len(sensors)
    )
    np.testing.assert_allclose(scores, expected[1], rtol=0, atol=1e-8)
    assert ranking == expected[0]


@pytest.mark.parametrize('seed', range(3))
def test_the_port_equals_the_literal_double_sums(seed):
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(9, 2))
    returns = z[:, 0] + 0.5 * rng.normal(size=9)
    folds, centers = np.arange(9) // 3, np.arange(0, 9, 2)
    objective, plug_in = direct_lsmi(
        returns, z, folds, centers, widths=WIDTHS, regularizations=REGULARIZATIONS
    )
    step = StepSamples(returns, z, folds, centers)
    held_out = conditional_mi([step], (0, 1), 'held_out', 2)
    assert held_out == pytest.approx(-2 * objective - 1, abs=1e-10)
    assert conditional_mi([step], (0, 1), 'plug_in', 2) == pytest.approx(plug_in, abs=1e-10)
