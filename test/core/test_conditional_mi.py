# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from oracles import direct_lsmi

from cmifs_ros.core import ConditionalMI, Episode, Lsmi, discounted_returns
from cmifs_ros.core.samples import step_samples

WIDTHS = (0.3, 1.0, 3.0)
LAMBDAS = (0.001, 0.1)
SAMPLING = {'gamma': 0.9, 'standardize': True, 'max_time_bins': None, 'random_state': 3}


def random_episodes(lengths, channels=2, seed=0):
    rng = np.random.default_rng(seed)
    return [Episode(rng.normal(size=(n, channels)), rng.normal(size=n)) for n in lengths]


def score(episodes, subsets, estimator=None, n_jobs=1, tuning_window=2, **changes):
    estimator = estimator or Lsmi(widths=WIDTHS, regularizations=LAMBDAS)
    folds = {'num_folds': estimator.num_folds, 'num_centers': estimator.num_centers}
    steps = step_samples(episodes, **(SAMPLING | folds | changes))
    return ConditionalMI(steps, estimator, tuning_window=tuning_window, n_jobs=n_jobs)(subsets)


@pytest.mark.parametrize('lengths', [(3,) * 12, (1, 2, 2, 3, 3, 3, 3, 3, 3, 4, 4, 5)])
def test_it_is_the_mean_over_steps_weighted_by_the_episodes_that_reach_them(lengths):
    episodes = random_episodes(lengths)
    steps = step_samples(episodes, **SAMPLING, num_folds=5, num_centers=None)
    assert [len(s.returns) for s in steps] == [
        sum(n > t for n in lengths) for t in range(max(lengths))
    ]
    expected = 0.0
    for step in steps:
        if len(step.returns) > 1:
            objective, _ = direct_lsmi(
                step.returns,
                step.states[:, [1]],
                step.folds,
                step.centers,
                widths=WIDTHS,
                regularizations=LAMBDAS,
            )
            expected += len(step.returns) / sum(lengths) * (-2 * objective - 1)
    assert score(episodes, [(1,)], tuning_window=0) == pytest.approx([expected], abs=1e-8)


def test_samples_hold_the_returns_and_states_of_their_step():
    episodes = random_episodes((2, 4, 3))
    raw = SAMPLING | {'standardize': False}
    steps = step_samples(episodes, **raw, num_folds=5, num_centers=None)
    for t, step in enumerate(steps):
        reached = [e for e in episodes if len(e) > t]
        np.testing.assert_array_equal(step.states, [e.states[t] for e in reached])
        expected = [discounted_returns(e.rewards, 0.9)[t] for e in reached]
        np.testing.assert_allclose(step.returns, expected)


def test_standardised_samples_have_mean_0_and_spread_1_and_constants_become_0():
    rng = np.random.default_rng(0)
    episodes = [
        Episode(np.column_stack([5 + 3 * rng.normal(size=4), np.full(4, 0.1)]), rng.normal(size=4))
        for _ in range(9)
    ]
    steps = step_samples(episodes, **SAMPLING, num_folds=5, num_centers=None)
    states = np.concatenate([s.states for s in steps])
    returns = np.concatenate([s.returns for s in steps])
    np.testing.assert_allclose(states.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(states.std(axis=0), [1, 0], atol=1e-12)
    assert (returns.mean(), returns.std()) == pytest.approx((0, 1))


def test_long_episodes_are_pooled_into_bins_without_splitting_an_episode_over_folds():
    episodes = random_episodes((100, 90, 100, 70, 100, 100))
    # The first channel names its episode.
    episodes = [
        Episode(np.column_stack([np.full(len(e), i), e.states]), e.rewards)
        for i, e in enumerate(episodes)
    ]
    settings = SAMPLING | {'max_time_bins': 8, 'standardize': False}
    bins = step_samples(episodes, **settings, num_folds=3, num_centers=20)
    assert len(bins) == 8
    assert sum(len(b.returns) for b in bins) == sum(map(len, episodes))
    for b in bins:
        assert len(b.centers) == 20 == len(set(b.centers.tolist()))
        owners = b.states[:, 0]
        assert all(len(set(b.folds[owners == owner])) == 1 for owner in set(owners))
        assert set(b.folds) == {0, 1, 2}


def test_threads_and_repetition_do_not_change_a_bit():
    episodes = random_episodes((4,) * 15)
    one = score(episodes, [(0,), (0, 1)])
    np.testing.assert_array_equal(score(episodes, [(0,), (0, 1)], n_jobs=2), one)
    np.testing.assert_array_equal(score(episodes, [(0,), (0, 1)]), one)


def test_affine_units_of_channels_and_rewards_do_not_matter_when_standardised():
    episodes = random_episodes((3,) * 15)
    scaled = [Episode(e.states * [1000, 0.01] + [5, -7], 60 * e.rewards) for e in episodes]
    assert score(scaled, [(0,), (0, 1)]) == pytest.approx(score(episodes, [(0,), (0, 1)]), abs=1e-9)
