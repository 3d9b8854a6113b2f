# SPDX-License-Identifier: Apache-2.0

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from cmifs_ros.core import ConditionalMISelector, Episode, permutation_test
from cmifs_ros.core.shadows import exchange


def independent(seed, num_episodes=20, steps=3, channels=2):
    """Return episodes whose states and rewards hardly change within one, and are independent."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(num_episodes, 1, channels))
    states = states + 0.1 * rng.normal(size=(num_episodes, steps, channels))
    rewards = rng.normal(size=(num_episodes, 1)) + 0.1 * rng.normal(size=(num_episodes, steps))
    return states, rewards


def dependent(seed, lengths):
    """Return episodes whose rewards depend on channels 1 and 3; 0 is constant, 2 nearly so."""
    rng = np.random.default_rng(seed)
    episodes = []
    for length in lengths:
        states = rng.normal(size=(length, 6))
        states[:, 0] = 5.0
        states[:, 2] = rng.random(length) < 0.1
        rewards = 2 * states[:, 1] + states[:, 3] + 0.1 * rng.normal(size=length)
        episodes.append(Episode(states, rewards))
    return episodes


@given(lengths=st.lists(st.integers(1, 6), min_size=1, max_size=8), seed=st.integers(0, 2**32 - 1))
def test_each_value_changes_places_at_its_own_step_and_trajectories_stay_whole(lengths, seed):
    # The value tells its trajectory and its step.
    trajectories = [10.0 * i + np.arange(n)[:, None] for i, n in enumerate(lengths)]
    exchanged = exchange(trajectories, np.random.default_rng(seed))
    assert [len(e) for e in exchanged] == lengths
    for step in range(max(lengths)):
        before, after = (
            [float(t[step, 0]) for t in some if len(t) > step] for some in (trajectories, exchanged)
        )
        assert sorted(before) == sorted(after)
    for trajectory in exchanged:
        sources = trajectory[:, 0] // 10
        for step in np.flatnonzero(np.diff(sources)):  # It changes only where one has ended.
            assert lengths[int(sources[step])] == step + 1


def test_all_exchanges_are_equally_likely():
    rng = np.random.default_rng(0)
    trajectories = [np.full((2, 1), i) for i in range(3)]
    seen = Counter(tuple(int(t[0, 0]) for t in exchange(trajectories, rng)) for _ in range(1200))
    assert len(seen) == 6
    assert stats.chisquare(list(seen.values())).pvalue > 0.001


def test_the_pvalue_is_uniform_where_the_return_depends_on_nothing():
    # Each of 1/10 to 10/10 is equally likely, though neighbouring steps are much alike.
    pvalues = [
        permutation_test(
            ConditionalMISelector(random_state=seed),
            independent(seed, 16, steps=2),
            n_permutations=9,
        ).pvalue
        for seed in range(200)
    ]
    counts = np.bincount(np.rint(np.array(pvalues) * 10).astype(int), minlength=11)
    assert counts.sum() - counts[0] == 200
    assert stats.chisquare(counts[1:]).pvalue > 0.01


@pytest.mark.parametrize('lengths', [[4] * 40, [1, 2, 3, 4, 5] * 10])
def test_the_pvalue_is_least_where_the_return_depends_on_a_sensor(lengths):
    selector = ConditionalMISelector(gamma=1e-6)
    result = permutation_test(selector, dependent(0, lengths), n_permutations=19)
    assert result.pvalue == 1 / 20
    assert len(result.null_distribution) == 19
    assert result.statistic > result.null_distribution.max()


def test_the_target_action_is_permuted_with_its_actions():
    episodes = [
        Episode(e.states, np.zeros(len(e)), e.rewards[:, None]) for e in dependent(0, [4] * 40)
    ]
    selector = ConditionalMISelector(target='action')
    assert permutation_test(selector, episodes, n_permutations=9).pvalue == 1 / 10
    shuffled = [
        Episode(a.states, b.rewards, b.actions)
        for a, b in zip(episodes, episodes[1:] + episodes[:1], strict=True)
    ]
    assert permutation_test(selector, shuffled, n_permutations=9).pvalue > 1 / 10


def test_a_test_repeats_and_leaves_the_selector_alone():
    selector = ConditionalMISelector(random_state=4)
    first, second = (permutation_test(selector, independent(1), n_permutations=5) for _ in range(2))
    np.testing.assert_array_equal(first.null_distribution, second.null_distribution)
    assert first.pvalue == second.pvalue
    with pytest.raises(RuntimeError, match='call fit'):
        selector.get_support()
    with pytest.raises(ValueError, match='n_permutations is 0; expected at least 1'):
        permutation_test(selector, independent(1), n_permutations=0)


def test_from_independent_data_nothing_is_selected():
    selected = [
        ConditionalMISelector(random_state=seed).fit(independent(seed, channels=4)).num_features_
        for seed in range(100, 140)
    ]
    # 5 % is what is promised: 6 of 40 would come about once in a hundred times.
    assert np.count_nonzero(selected) < 6


@pytest.mark.parametrize('direction', ['forward', 'backward'])
@pytest.mark.parametrize('lengths', [[3] * 50, [1, 2, 3, 4, 5] * 12])
def test_the_right_number_is_selected_of_any_lengths(lengths, direction):
    selectors = [
        ConditionalMISelector(gamma=1e-6, direction=direction, random_state=seed).fit(
            dependent(seed, lengths)
        )
        for seed in range(5)
    ]
    selected = [selector.get_support(indices=True).tolist() for selector in selectors]
    assert selected.count([1, 3]) >= 4, selected
    assert all(len(selector.ranking_) == 6 for selector in selectors)


def test_groups_stand_or_fall_whole():
    selector = ConditionalMISelector(gamma=1e-6, groups={'pose': [3, 1], 'rest': [4, 5]})
    selector.fit(dependent(0, [3] * 50), names=list('abcdef'))
    assert selector.get_feature_names_out().tolist() == ['d', 'b']
    assert selector.num_features_ == 1


def test_the_same_seed_selects_the_same_number():
    first, second = (ConditionalMISelector(random_state=2).fit(independent(7)) for _ in range(2))
    assert first.num_features_ == second.num_features_
