# SPDX-License-Identifier: Apache-2.0

"""The conditional test: what it finds, what it lets pass, and that it keeps its level."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from cmifs_ros.core.chance import combined_pvalue
from cmifs_ros.core.samples import Samples, collect_samples
from cmifs_ros.core.targets import TargetTest
from studies.tasks.level_worlds import rollout_level

NUM_EPISODES, NUM_STEPS, GAMMA = 40, 12, 0.9


def conditional_test(samples, gamma, seed, **options):
    names = [f'x{i}' for i in range(samples.states.shape[1])]
    return TargetTest(samples, 'return', names, [], gamma, random_state=seed, **options)


def slow(rng, num_channels, num_episodes=NUM_EPISODES):
    """Return channels that hardly change within an episode: shape (N, num_channels)."""
    level = rng.normal(size=(num_episodes, 1, num_channels))
    steps = 0.3 * rng.normal(size=(num_episodes, NUM_STEPS, num_channels)).cumsum(axis=1)
    return (level + steps).reshape(-1, num_channels)


def samples_of(returns, states, num_episodes=NUM_EPISODES):
    return Samples(
        returns,
        states,
        np.repeat(np.arange(num_episodes), NUM_STEPS),
        np.tile(np.arange(NUM_STEPS), num_episodes),
    )


def test_pvalues_of_what_tells_nothing_are_uniform():
    # The return depends on the first channel and, slowly, on what nobody sees.
    pvalues = []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        x, hidden, noise, walk = slow(rng, 4).T
        white = rng.normal(size=len(x))
        states = np.column_stack([x, noise, walk, white])
        test = conditional_test(samples_of(x**2 + hidden, states), GAMMA, seed)
        pvalues += [*test([(1,), (3,)], (0,)), *test([(2,)], ())]
    pvalues = np.array(pvalues)
    assert np.mean(pvalues <= 0.05) <= 0.1
    assert np.mean(pvalues <= 0.01) <= 0.03
    assert stats.kstest(pvalues, 'uniform', alternative='greater').pvalue > 0.01


@pytest.mark.parametrize('num_episodes', [6, 10])
def test_the_level_holds_with_few_episodes(num_episodes):
    pvalues = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        hidden, noise = slow(rng, 2, num_episodes).T
        test = conditional_test(samples_of(hidden, noise[:, None], num_episodes), GAMMA, seed)
        pvalues.append(test([(0,)], ())[0])
    assert np.mean(np.array(pvalues) <= 0.05) <= 0.12
    assert np.mean(np.array(pvalues) <= 0.005) <= 0.03


def test_what_tells_something_beyond_the_given_is_found():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x, y, hidden = slow(rng, 3).T
        returns = x + np.abs(y) + 0.3 * hidden
        test = conditional_test(samples_of(returns, np.column_stack([x, y])), GAMMA, seed)
        assert test([(0,)], ())[0] < 0.01
        assert test([(1,)], (0,))[0] < 0.01  # no linear relation, and hidden by x


def test_what_tells_only_the_next_reward_is_found_among_the_noise_of_later_ones():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        sensor, noise = rng.normal(size=(2, NUM_EPISODES, NUM_STEPS))
        rewards = 0.4 * sensor + noise
        returns = np.zeros_like(rewards)
        after = np.zeros(NUM_EPISODES)
        for t in reversed(range(NUM_STEPS)):
            returns[:, t] = after = rewards[:, t] + after
        samples = samples_of(returns.ravel(), sensor.reshape(-1, 1))
        assert conditional_test(samples, 1.0, seed)([(0,)], ())[0] < 1e-3


def test_what_a_sensor_tells_only_together_with_a_given_channel_is_found():
    # Of six given channels one says which way the sensor counts.
    pvalues = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        *beside, sensor, hidden = slow(rng, 8).T
        returns = beside[0] + beside[3] * sensor + 0.5 * hidden
        test = conditional_test(
            samples_of(returns, np.column_stack([*beside, sensor])), GAMMA, seed
        )
        pvalues.append(test([(6,)], range(6))[0])
    assert np.median(pvalues) < 0.01


def wandering(rng, num_channels, num_episodes):
    """Return channels that are the same within an episode and much like the one before."""
    level = rng.normal(size=(num_episodes, num_channels))
    for i in range(1, num_episodes):
        level[i] = 0.9 * level[i - 1] + np.sqrt(1 - 0.9**2) * level[i]
    return np.repeat(level, NUM_STEPS, axis=0)


def test_what_wanders_from_episode_to_episode_is_no_evidence_of_what_does_so_too():
    pvalues = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        *sensors, hidden = wandering(rng, 4, 100).T
        returns = hidden + slow(rng, 1, 100)[:, 0] / 3
        test = conditional_test(samples_of(returns, np.column_stack(sensors), 100), GAMMA, seed)
        pvalues += list(test([(0,), (1,), (2,)], ()))
    assert np.mean(np.array(pvalues) <= 0.05) <= 0.12
    assert np.mean(np.array(pvalues) <= 0.005) <= 0.03


def test_what_tells_something_is_found_though_the_return_wanders():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = slow(rng, 1, 100)[:, 0]
        sensor, hidden = wandering(rng, 2, 100).T
        states = np.column_stack([x, sensor + 0.1 * x])
        returns = x + sensor + hidden
        test = conditional_test(samples_of(returns, states, 100), GAMMA, seed)
        assert test([(0,)], ())[0] < 1e-3


def test_what_the_given_tell_already_is_nothing():
    seen = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x, hidden = slow(rng, 2).T
        blurred = np.tanh(x) + 0.5 * rng.normal(size=len(x))
        states = np.column_stack([x, x, np.exp(x), blurred])
        test = conditional_test(samples_of(np.sin(x) + 0.3 * hidden, states), GAMMA, seed)
        assert test([(3,)], ())[0] < 0.01  # by itself it does tell
        assert test([(1,)], (0,))[0] == 1
        assert test([(2,)], (0,))[0] > 0.01
        seen.append(test([(3,)], (0,))[0])
    assert np.mean(np.array(seen) <= 0.05) <= 0.2


def test_an_echo_of_the_action_in_a_few_long_episodes_is_no_evidence():
    pvalues = []
    for seed in range(12):
        episodes = rollout_level('echo_of_action', 10, seed)
        samples = collect_samples(episodes, gamma=0.95, standardize=True)
        load, heat, echo = 0, 1, 2
        pvalues.append(conditional_test(samples, 0.95, seed)([(echo,)], [load, heat])[0])
    assert np.mean(np.array(pvalues) <= 0.05) <= 0.25  # 12 of 12 with ten columns at most
    assert min(pvalues) > 1e-3


def test_the_step_is_given():
    rng = np.random.default_rng(0)
    step = np.tile(np.arange(NUM_STEPS), NUM_EPISODES).astype(float)
    returns = -step + 0.1 * rng.normal(size=len(step))
    clock = 7 + 2 * step
    samples = samples_of(returns, clock[:, None])
    assert conditional_test(samples, GAMMA, 0)([(0,)], ())[0] == 1


def test_switches_that_matter_only_together_are_seen_together():
    rng = np.random.default_rng(0)
    a, b = np.repeat(rng.integers(0, 2, size=(2, NUM_EPISODES)), NUM_STEPS, axis=1)
    returns = (a ^ b) + 0.1 * rng.normal(size=len(a))
    test = conditional_test(samples_of(returns, np.column_stack([a, b]).astype(float)), GAMMA, 0)
    assert test([(0,)], ())[0] > 0.05
    assert test([(0,)], (1,))[0] < 1e-3
    assert test([(0, 1)], ())[0] < 1e-3


def test_of_both_parts_the_greater_pvalue_counts_where_signs_show_something():
    rng = np.random.default_rng(3)
    states = slow(rng, 30)
    samples = samples_of(states[:, 0] + slow(rng, 1)[:, 0], states)
    candidates = [(c,) for c in range(30)]
    signs, shifts, both = (
        conditional_test(samples, GAMMA, 0, level=0.2, **parts)(candidates, [])
        for parts in ({'parts': ('signs',)}, {'parts': ('shifts',)}, {})
    )
    assert 0 < np.sum(signs <= 0.2) < 30
    assert np.any(shifts > signs)
    expected = np.where(signs <= 0.2, np.maximum(signs, shifts), signs)
    np.testing.assert_array_equal(both, expected)


@pytest.mark.parametrize('ordered', [True, False])
def test_signs_hold_the_level_in_windows_of_one_drive_if_their_order_is_known(ordered):
    # Returns and channels remember four windows; as if windows were independent, too much is found.
    num_windows, share = 120, np.exp(-1 / 4)
    pvalues = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        levels = rng.normal(size=(num_windows, 5))
        for t in range(1, num_windows):
            levels[t] = share * levels[t - 1] + np.sqrt(1 - share**2) * levels[t]
        rows = np.repeat(levels, NUM_STEPS, axis=0)
        rows += 0.3 * rng.normal(size=rows.shape)
        samples = samples_of(rows[:, 0], rows[:, 1:], num_windows)
        test = conditional_test(samples, 0.0, seed, ordered=ordered, parts=('signs',))
        pvalues += [*test([(c,) for c in range(4)], ())]
    share = np.mean(np.array(pvalues) <= 0.05)
    assert share <= 0.1 if ordered else share > 0.15


def test_neither_units_nor_other_channels_matter():
    rng = np.random.default_rng(0)
    x, y, noise, hidden = slow(rng, 4).T
    returns = x + y + hidden
    test = conditional_test(samples_of(returns, np.column_stack([x, y, noise])), GAMMA, 0)
    other = conditional_test(
        samples_of(3 * returns - 5, np.column_stack([noise, 1e6 * y + 1e7, 1e-3 * x])),
        GAMMA,
        0,
    )
    assert other([(1,)], (2,))[0] == pytest.approx(test([(1,)], (0,))[0], rel=1e-4)


def test_a_long_record_is_thinned():
    rng = np.random.default_rng(0)
    x, hidden = slow(rng, 2, 1000).T
    test = conditional_test(samples_of(x + hidden, x[:, None], 1000), GAMMA, 0)
    assert test([(0,)], ())[0] < 1e-6


def test_returns_without_any_change_are_no_evidence():
    rng = np.random.default_rng(0)
    x = slow(rng, 1)
    assert conditional_test(samples_of(np.ones(len(x)), x), GAMMA, 0)([(0,)], ())[0] == 1


def test_two_episodes_are_too_few():
    rng = np.random.default_rng(0)
    x = slow(rng, 1, 2)
    assert conditional_test(samples_of(x[:, 0], x, 2), GAMMA, 0)([(0,)], ())[0] > 0.05


@given(st.lists(st.floats(1e-12, 1.0), min_size=1, max_size=8), st.floats(1e-12, 1.0))
def test_combined_pvalues_lie_between_the_least_and_as_many_times_it(pvalues, same):
    combined = combined_pvalue(pvalues)
    assert min(pvalues) * (1 - 1e-9) <= combined <= max(pvalues) * (1 + 1e-9)
    if combined <= 1e-4:  # Of greater ones those that are all but 1 take a part.
        assert combined <= 1.02 * len(pvalues) * min(pvalues)
    assert combined_pvalue([same] * len(pvalues)) == pytest.approx(same)
    assert combined_pvalue(pvalues[::-1]) == pytest.approx(combined)


def test_combined_pvalues_of_chance_are_those_of_chance():
    rng = np.random.default_rng(0)
    alone = rng.random((20000, 4))
    alike = special.ndtr(rng.normal(size=(20000, 1)) + 0.5 * rng.normal(size=(20000, 4)))
    for pvalues in (alone, stats.rankdata(alike, axis=0) / 20001):
        share = np.mean([combined_pvalue(p) <= 0.01 for p in pvalues])
        assert 0.005 < share < 0.013
    assert combined_pvalue([]) == 1
