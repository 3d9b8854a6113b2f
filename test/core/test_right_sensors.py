# SPDX-License-Identifier: Apache-2.0

"""Small worlds in which the truth is known: the selector finds it, by default and by itself."""

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode
from studies.tasks.level_worlds import rollout_level
from studies.tasks.rewards import REWARD_WORLDS
from studies.tasks.synthetic import WORLDS, rollout_synthetic

SEEDS = range(3)


def fitted(world, num_episodes, seed, **settings):
    selector = ConditionalMISelector(groups=WORLDS[world].groups, random_state=seed, **settings)
    return selector.fit(
        rollout_synthetic(world, num_episodes, seed), names=WORLDS[world].channel_names
    )


def ranked(selector):
    return [selector.sensor_names_[i] for i in selector.ranking_]


def selected(selector):
    return ranked(selector)[: selector.num_features_]


@pytest.mark.parametrize(
    'world',
    [
        'copy',
        'noisy_copy',
        'dead_channel',
        'two_switches',
        'wild_readings',
        'one_wild_reading',
        'one_of_twelve',
        'twelve_of_noise',
        'beside',
        'drift',
        'wandering',
    ],
)
def test_what_is_selected_is_what_is_relevant(world):
    relevant = set(WORLDS[world].relevant)
    copies = {'copy': 'x'} if 'copy' in WORLDS[world].channel_names else {}
    found = [[copies.get(n, n) for n in selected(fitted(world, 60, seed))] for seed in range(6)]
    right = [sorted(names) == sorted(relevant) for names in found]
    assert sum(right) >= 4, found


@pytest.mark.parametrize('target', ['return', 'decision'])
@pytest.mark.parametrize('weight', [0.0, 0.8])
def test_a_product_of_two_is_found_beside_another_sensor_and_without(weight, target):
    # The mean of each is 0 whatever the other is, so neither shows anything by itself.
    found = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        states, actions = rng.normal(size=(50, 20, 6)), rng.normal(size=(50, 20, 1))
        rewards = states[..., 1] * states[..., 2] + weight * states[..., 0]
        rewards += actions[..., 0] + rng.normal(size=rewards.shape)
        episodes = [Episode(*one) for one in zip(states, rewards, actions, strict=True)]
        selector = ConditionalMISelector(target=target, gamma=0.5).fit(episodes)
        found.append(sorted(selector.get_feature_names_out()))
    assert found == [['x0', 'x1', 'x2'] if weight else ['x1', 'x2']] * 2


def test_an_ordinary_robot_is_understood_from_60_episodes():
    relevant, right = {'x', 'y', 'battery'}, []
    for seed in range(5):
        selector = fitted('point_robot', 60, seed)
        confirmed = set(selected(selector))
        right.append(set(ranked(selector)[:3]) == relevant <= confirmed)
        assert confirmed <= relevant | {'vx', 'vy'}
    assert sum(right) >= 4


def test_copies_come_after_what_tells_a_little():
    for seed in SEEDS:
        ranking = ranked(fitted('copy', 60, seed))
        assert {'x', 'copy'} & set(ranking[:1])
        assert ranking[1] == 'y'


def test_a_wanted_number_is_met_with_the_best_so_far():
    selector = fitted('dead_channel', 60, 0, num_features=4)
    assert ranked(selector)[:2] == ['x', 'y']
    assert len(selected(selector)) == 4
    assert 'dead' not in selected(selector)
    assert selector.statuses_[:2] == ['confirmed', 'confirmed']
    confirmed = [status == 'confirmed' for status in selector.statuses_]
    assert confirmed == [p <= 0.05 for p in selector.pvalues_]


def test_scores_of_what_tells_nothing_lie_below_those_of_what_is_confirmed():
    selector = fitted('copy', 60, 0)
    low, median, high = selector.null_scores_.T
    assert (low <= median).all()
    assert (median <= high).all()
    num = selector.num_features_
    assert (selector.scores_[:num] > high[:num]).all()
    assert (selector.pvalues_[:num] <= selector.significance).all()


def test_the_channel_that_speaks_for_a_group_is_named():
    selector = fitted('one_of_twelve', 60, 0)
    supporting = dict(zip(ranked(selector), selector.supporting_channels_, strict=True))
    assert supporting['scan'] == (0,)


def test_a_copy_is_redundant_with_what_it_copies():
    rightly = 0
    for seed in range(5):
        selector = fitted('copy', 60, seed)
        redundant_with = dict(zip(ranked(selector), selector.redundant_with_, strict=True))
        taken, left = ('x', 'copy') if 'x' in selected(selector) else ('copy', 'x')
        place = selector.sensor_names_.index(taken)
        assert redundant_with.pop(left) == (place,)
        rightly += not any(redundant_with.values())
    assert rightly >= 4


def test_further_channels_of_a_group_speak_where_they_tell_something():
    joined = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        scan, noise = rng.normal(size=(2, 60, 15, 8)).cumsum(axis=2)
        returns = scan[..., 2] + 0.7 * np.abs(scan[..., 6])
        rewards = returns - 0.95 * np.roll(returns, -1, axis=1)
        rewards[:, -1] = returns[:, -1]
        names = [*(f'scan[{i}]' for i in range(8)), *(f'noise_{i}' for i in range(3))]
        states = np.concatenate([scan, noise[..., :3]], axis=-1)
        selector = ConditionalMISelector(groups={'scan': names[:8]}).fit(
            (states, rewards), names=names
        )
        assert ranked(selector)[0] == 'scan'
        assert {2, 6} <= set(selector.supporting_channels_[0])
        joined.append(len(selector.supporting_channels_[0]))
    assert sorted(joined)[:4] == [2] * 4


def test_of_equals_the_one_in_use_stays():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 60, 12)).cumsum(axis=2)
    twins = [x + 0.02 * rng.normal(size=x.shape) for _ in range(2)]
    states = np.stack([*twins, y, rng.normal(size=x.shape)], axis=-1)
    names = ['twin_1', 'twin_2', 'y', 'noise']
    for in_use in ('twin_1', 'twin_2'):
        selector = ConditionalMISelector().fit(
            (states, x + y), names=names, start=[in_use, 'noise', 'gone']
        )
        assert set(selected(selector)) == {in_use, 'y'}


@pytest.mark.parametrize(
    ('world', 'num_episodes'),
    [('readme_reward_1', 60), ('readme_reward_10', 60), ('rare_goal', 300), ('grasps', 80)],
)
def test_rewards_count_as_they_are_written(world, num_episodes):
    draw, names, relevant, _ = REWARD_WORLDS[world]
    found = []
    for seed in range(4):
        drawn = (draw(np.random.default_rng([seed, i]), i) for i in range(num_episodes))
        selector = ConditionalMISelector(random_state=seed)
        selector.fit([Episode(*of_one) for of_one in drawn], names)
        found.append(set(selected(selector)))
    assert sum(bool(of & set(relevant)) for of in found) >= 3, found
    assert sum(bool(of & {name for name in names if 'noise' in name}) for of in found) <= 1, found


def test_a_reward_that_is_far_off_hides_nothing():
    draw, names, relevant, _ = REWARD_WORLDS['one_great_penalty']
    episodes = [Episode(*draw(np.random.default_rng([0, i]), i)) for i in range(60)]
    with pytest.warns(UserWarning, match='1 reward of'):
        selector = ConditionalMISelector().fit(episodes, names)
    assert tuple(selected(selector)) == relevant


@pytest.mark.parametrize(
    ('world', 'num_episodes', 'num_shown'),
    [
        ('vibration', 80, 1),
        ('the_better_the_longer', 60, 1),
        ('windows_memory_200', 50, 0),
        ('fleet', 60, 1),
    ],
)
def test_irrelevant_sensors_are_left_out_where_a_test_errs_easily(world, num_episodes, num_shown):
    # Eight irrelevant sensors or more; 5 % of the recordings may have one of them by chance.
    wrong = found = 0
    for seed in range(8):
        selector = ConditionalMISelector(random_state=seed)
        support = selector.fit(rollout_level(world, num_episodes, seed)).get_support(indices=True)
        wrong += bool((support >= num_shown).any())
        found += bool((support < num_shown).any())
    assert wrong <= 2
    assert found >= 7 * bool(num_shown)


def test_a_cause_that_is_seen_early_and_a_reward_that_is_paid_late_are_put_together():
    right = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        states, weight = rng.normal(size=(80, 30, 3)), rng.normal(size=80)
        states[:, :5, 0] += 3 * weight[:, None]
        rewards = np.zeros((80, 30))
        rewards[:, -1] = weight + 0.5 * rng.normal(size=80) > 0
        right += ConditionalMISelector().fit((states, rewards)).get_support(True).tolist() == [0]
    assert right >= 3


def test_a_weak_sensor_is_found_in_many_episodes():
    draw, names, relevant, _ = REWARD_WORLDS['weak_sensor']
    drawn = (draw(np.random.default_rng([0, i]), i) for i in range(4000))
    selector = ConditionalMISelector().fit([Episode(*of_one) for of_one in drawn], names)
    assert set(selected(selector)) == set(relevant)
