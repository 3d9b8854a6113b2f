# SPDX-License-Identifier: Apache-2.0

import subprocess
import sys

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode


def toy(num_episodes=40, steps=3, seed=0):
    """Return arrays in which the reward depends on channels 2 and 0 of 4, on 2 the most."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(num_episodes, steps, 4))
    rewards = 2 * states[..., 2] + states[..., 0] + 0.1 * rng.normal(size=(num_episodes, steps))
    return states, rewards


SELECTORS = {
    'default': ConditionalMISelector,
    'paper': ConditionalMISelector.paper,
}


@pytest.mark.parametrize('kind', SELECTORS)
@pytest.mark.parametrize('direction', ['forward', 'backward'])
def test_it_finds_what_the_reward_depends_on(kind, direction):
    # gamma near 0: the return is the reward.
    selector = SELECTORS[kind](2, gamma=1e-6, direction=direction).fit(toy())
    assert selector.get_support(indices=True).tolist() == [2, 0]
    assert selector.get_support().tolist() == [True, False, True, False]


def test_scikit_learns_manners():
    states, rewards = toy()
    selector = ConditionalMISelector(2, gamma=1e-6)
    assert selector.fit((states, rewards), names=['a', 'b', 'c', 'd']) is selector
    assert selector.get_feature_names_out().tolist() == ['c', 'a']
    assert selector.n_features_in_ == 4
    np.testing.assert_array_equal(selector.transform(states), states[..., [2, 0]])
    np.testing.assert_array_equal(selector.transform(states[0, 0]), states[0, 0, [2, 0]])
    assert len(selector.ranking_) == len(selector.scores_) == 2


def test_the_columns_of_a_data_frame_go_by_their_names():
    pandas = pytest.importorskip('pandas', reason='pandas is not here')
    states, rewards = toy()
    selector = ConditionalMISelector(2, gamma=1e-6).fit((states, rewards), names=list('abcd'))
    frame = pandas.DataFrame(states[0], columns=list('abcd'))
    for columns in ('abcd', 'dbca', 'ca'):
        np.testing.assert_array_equal(
            selector.transform(frame[list(columns)]), states[0][:, [2, 0]]
        )
    with pytest.raises(
        ValueError, match='no column c; expected the names given to fit: a, b, c, d'
    ):
        selector.transform(frame[['a', 'b', 'd']])
    other = frame.set_axis(list('wxyz'), axis='columns')  # without these names, by place
    np.testing.assert_array_equal(selector.transform(other), states[0][:, [2, 0]])


def test_a_list_of_episodes_is_shown_without_its_numbers():
    episodes = [Episode(np.zeros((100, 3)), np.zeros(100), np.zeros(100), 'arm') for _ in range(2)]
    assert repr(episodes[0]) == "Episode(100 steps, 3 channels, 1 action value, source='arm')"
    assert len(repr(episodes)) < 200


def test_a_delayed_effect_is_found_through_the_return():
    # Channel 1 decides the reward two steps later; channel 0 is noise.
    rng = np.random.default_rng(0)
    states = rng.normal(size=(60, 4, 2))
    rewards = np.zeros((60, 4))
    rewards[:, 2:] = states[:, :2, 1]
    selector = ConditionalMISelector(1, gamma=0.95).fit((states, rewards))
    assert selector.get_support(indices=True).tolist() == [1]


def test_same_seed_same_result_bit_for_bit():
    first = ConditionalMISelector(random_state=5).fit(toy())
    second = ConditionalMISelector(random_state=5).fit(toy())
    np.testing.assert_array_equal(first.ranking_, second.ranking_)
    np.testing.assert_array_equal(first.scores_, second.scores_)


def test_order_of_channels_does_not_matter():
    states, rewards = toy()
    order = [3, 1, 0, 2]
    names = np.array(['a', 'b', 'c', 'd'])
    one = ConditionalMISelector().fit((states, rewards), names=names.tolist())
    other = ConditionalMISelector().fit((states[..., order], rewards), names=names[order].tolist())
    assert [other.sensor_names_[i] for i in other.ranking_] == [
        one.sensor_names_[i] for i in one.ranking_
    ]
    np.testing.assert_allclose(other.scores_, one.scores_, rtol=0, atol=1e-10)


def test_without_a_number_it_ranks_all_and_takes_those_that_matter():
    selector = ConditionalMISelector(gamma=1e-6).fit(toy())
    assert sorted(selector.ranking_.tolist()) == [0, 1, 2, 3]
    assert selector.num_features_ == 2
    assert selector.statuses_[:2] == ['confirmed', 'confirmed']
    assert 'confirmed' not in selector.statuses_[2:]
    assert selector.get_support(indices=True).tolist() == [2, 0]


def test_without_any_dependence_it_selects_nothing():
    rng = np.random.default_rng(0)
    episodes = [Episode(rng.normal(size=(3, 2)), np.ones(3)) for _ in range(30)]
    selector = ConditionalMISelector().fit(episodes)
    assert selector.num_features_ == 0
    assert selector.get_support(indices=True).tolist() == []
    assert selector.transform(np.zeros((5, 2))).shape == (5, 0)


def test_a_group_is_selected_whole_and_named():
    selector = ConditionalMISelector(1, gamma=1e-6, groups={'pose': ['c', 'a']})
    selector.fit(toy(), names=['a', 'b', 'c', 'd'])
    assert selector.sensor_names_ == ('pose', 'b', 'd')
    assert selector.sensor_names_[selector.ranking_[0]] == 'pose'
    assert selector.get_feature_names_out().tolist() == ['c', 'a']
    by_index = ConditionalMISelector(1, gamma=1e-6, groups={'pose': np.array([2, 0])}).fit(toy())
    assert by_index.get_support(indices=True).tolist() == [2, 0]


def test_episodes_of_any_length_are_taken():
    rng = np.random.default_rng(0)
    episodes = []
    for length in rng.integers(1, 50, size=40):
        states = rng.normal(size=(length, 3))
        episodes.append(Episode(states, states[:, 1] + 0.1 * rng.normal(size=length)))
    selector = ConditionalMISelector(1, gamma=1e-6, num_centers=50).fit(episodes)
    assert selector.get_support(indices=True).tolist() == [1]


def test_huge_values_give_finite_scores():
    states, rewards = toy(12, 2)
    selector = ConditionalMISelector(2).fit((states * 1e150, rewards * 1e150))
    assert np.isfinite(selector.scores_).all()


@pytest.mark.parametrize('rewards', [toy(20, 2)[1], np.ones((20, 2))])
def test_what_never_changes_is_not_selected_whatever_number_is_asked(rewards):
    states = np.ones((20, 2, 4)) + np.arange(20)[:, None, None] * [1, 0, 0, 0]
    selector = ConditionalMISelector().fit((states, rewards))
    assert selector.num_features_ == 0
    assert np.isfinite(selector.scores_).all()
    assert selector.statuses_[-3:] == ['dispensable'] * 3
    with pytest.raises(ValueError, match='num_features is 2, but only 1 sensors ever change'):
        ConditionalMISelector(2).fit((states, rewards))


def test_of_constants_alone_nothing_is_selected():
    selector = ConditionalMISelector().fit((np.ones((20, 2, 3)), toy(20, 2)[1]))
    assert selector.statuses_ == ['dispensable'] * 3
    assert selector.transform(np.ones((2, 3))).shape == (2, 0)


def test_huge_units_do_not_change_the_selection_and_overflowing_returns_are_refused():
    states, rewards = toy(20, 2)
    usual = ConditionalMISelector(2).fit((states, rewards))
    huge = ConditionalMISelector(2).fit((states * 1e300, rewards * 1e300))
    assert huge.ranking_.tolist() == usual.ranking_.tolist()
    np.testing.assert_allclose(huge.scores_, usual.scores_, rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match=r'a reward is 1e\+308 in size'):
        ConditionalMISelector(2).fit((states, np.full_like(rewards, 1e308)))


@pytest.mark.parametrize(
    ('settings', 'message'),
    [
        ({'num_features': 5}, 'num_features is 5; expected 1 to 4'),
        ({'num_features': 0}, 'num_features is 0; expected 1 to 4'),
        ({'num_features': 'a'}, "num_features is 'a'; expected 1 to 4"),
        ({'n_jobs': 'a'}, "n_jobs is 'a'; expected a whole number, at least 1"),
        ({'n_jobs': 1.5}, 'n_jobs is 1.5; expected a whole number'),
        ({'random_state': None}, 'random_state is None; expected a whole number, at least 0'),
        ({'random_state': -1}, 'random_state is -1; expected a whole number, at least 0'),
        ({'gamma': 0.0}, 'gamma is 0.0; expected 0 < gamma <= 1'),
        ({'criterion': 'mi'}, "criterion is 'mi'; expected one of held_out, plug_in"),
        ({'direction': 'up'}, "direction is 'up'; expected one of forward, backward"),
        ({'max_time_bins': 0}, 'max_time_bins is 0'),
        ({'max_time_bins': 2.5}, 'max_time_bins is 2.5; expected a whole number'),
        ({'num_centers': 0}, 'num_centers is 0'),
        ({'num_centers': 2.5}, 'num_centers is 2.5; expected a whole number'),
        ({'groups': {'g': []}}, "group 'g' is empty"),
        ({'groups': {'g': ['q']}}, "group 'g' names channel 'q'; expected one of a, b, c, d"),
        ({'groups': {'g': ['a'], 'h': [0]}}, "channel 'a' is in two groups, 'g' and 'h'"),
        ({'groups': {'a': ['b']}}, "'a' names a group and a channel outside it"),
    ],
)
def test_bad_settings_are_refused_by_name(settings, message):
    with pytest.raises(ValueError, match=message):
        ConditionalMISelector(**settings).fit(toy(), names=['a', 'b', 'c', 'd'])


@pytest.mark.parametrize(
    ('names', 'message'),
    [
        (['a', 'b'], 'there are 2 names; expected 4'),
        (['a', 'b', 'b', 'c'], "channel name 'b' is empty or repeated"),
        (['a', '', 'b', 'c'], "channel name '' is empty or repeated"),
    ],
)
def test_bad_names_are_refused(names, message):
    with pytest.raises(ValueError, match=message):
        ConditionalMISelector().fit(toy(), names=names)


def test_one_episode_is_too_few_and_an_unfitted_selector_says_so():
    states, rewards = toy()
    with pytest.raises(ValueError, match='there is 1 episode; expected at least 2'):
        ConditionalMISelector().fit((states[:1], rewards[:1]))
    with pytest.raises(RuntimeError, match='call fit'):
        ConditionalMISelector().transform(states)
    with pytest.raises(ValueError, match=r'states has shape \(3,\); expected 4 channels'):
        ConditionalMISelector(1).fit((states, rewards)).transform(np.zeros(3))


def test_core_and_sim_need_no_ros_and_no_plots():
    code = (
        'import sys, cmifs_ros.core, cmifs_ros.sim; '
        'print([m for m in ("rclpy", "matplotlib", "tqdm", "yaml") if m in sys.modules])'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


def test_the_linear_algebra_has_one_thread_meanwhile():
    threadpoolctl = pytest.importorskip('threadpoolctl', reason='threadpoolctl is not here')

    def threads():
        pools = threadpoolctl.threadpool_info()
        return {pool['num_threads'] for pool in pools if pool['user_api'] == 'blas'}

    seen = []
    with threadpoolctl.threadpool_limits(2, 'blas'):
        ConditionalMISelector().fit(toy(), progress=lambda _: seen.append(threads()))
        assert threads() == {2}
    assert seen
    assert all(count == {1} for count in seen)
