# SPDX-License-Identifier: Apache-2.0

"""What is selected for each target: the action given, what a decision needs, what is looked at."""

import re
import warnings

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode
from studies.tasks.control import CONTROL_WORLDS, rollout_control


def selected(name, target, seed=0, *, with_actions=True, **settings):
    world = CONTROL_WORLDS[name]
    episodes = rollout_control(name, world.num_episodes, seed, is_skilled=target == 'action')
    if not with_actions:
        episodes = [Episode(e.states, e.rewards) for e in episodes]
    selector = ConditionalMISelector(target=target, random_state=seed, **settings)
    return selector.fit(episodes, world.channel_names)


@pytest.mark.parametrize(
    ('name', 'target'),
    [('match', 'return'), ('secret_key', 'return'), ('stakes', 'decision'), ('toy', 'decision')],
)
def test_what_is_needed_is_selected(name, target):
    needed = set(CONTROL_WORLDS[name].needed_for[target])
    exact = [set(selected(name, target, seed).get_feature_names_out()) == needed for seed in (0, 1)]
    assert any(exact)
    assert needed <= set(selected(name, target).get_feature_names_out())


def test_what_matters_only_with_the_action_is_not_seen_without():
    assert 'hue' in selected('match', 'return').get_feature_names_out()
    assert selected('match', 'return', with_actions=False).num_features_ == 0


def test_a_decision_without_actions_is_told_to_lack_them():
    found = [selected('match', 'decision', with_actions=given).warnings_ for given in (True, False)]
    assert [any('there are no actions' in one for one in of) for of in found] == [False, True]


def test_a_skilled_controller_is_told_and_its_actions_show_what_it_looks_at():
    world = CONTROL_WORLDS['stakes']
    episodes = rollout_control('stakes', world.num_episodes, 0, is_skilled=True)
    without_rewards = [Episode(e.states, None, e.actions) for e in episodes]
    selector = ConditionalMISelector(target='action').fit(without_rewards, world.channel_names)
    assert list(selector.get_feature_names_out()) == ['bet']
    with pytest.warns(UserWarning, match="target 'action'"):
        ConditionalMISelector().fit(episodes, world.channel_names)


def test_of_several_actions_the_one_that_follows_from_the_sensors_is_named():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(40, 10, 2))
    drive = states[..., 0] + 0.1 * rng.normal(size=(40, 10))
    actions = np.stack([drive, rng.normal(size=(40, 10)), rng.normal(size=(40, 10))], axis=2)
    episodes = [Episode(s, r, a) for s, r, a in zip(states, drive, actions, strict=True)]
    with pytest.warns(UserWarning, match='follows from the sensors'):
        selector = ConditionalMISelector().fit(episodes, action_names=['drive', 'turn', 'lift'])
    assert re.search(r'they predict 9\d% of drive\)', ' '.join(selector.warnings_))


@pytest.mark.parametrize('target', ['return', 'decision'])
def test_episodes_of_a_single_step_are_enough(target):
    rng = np.random.default_rng(0)
    states, actions = rng.normal(size=(80, 1, 3)), rng.normal(size=(80, 1, 1))
    rewards = states[..., 0] * actions[..., 0] + 0.1 * rng.normal(size=(80, 1))
    episodes = [Episode(s, r, a) for s, r, a in zip(states, rewards, actions, strict=True)]
    selector = ConditionalMISelector(target=target).fit(episodes, ['bet', 'rain', 'noise'])
    assert list(selector.get_feature_names_out()) == ['bet']


def test_why_says_for_what_a_sensor_is_needed():
    selector = selected('stakes', 'decision')
    names = [selector.sensor_names_[i] for i in selector.ranking_[: selector.num_features_]]
    why = dict(zip(names, selector.why_, strict=False))
    assert why['bet'] == 'reward'
    assert why['key'] == 'predicts level'


def test_actions_are_never_candidates():
    selector = selected('match', 'return')
    assert selector.sensor_names_ == CONTROL_WORLDS['match'].channel_names


def test_nothing_is_selected_where_nothing_matters():
    for target in ('return', 'decision', 'action'):
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            assert sum(selected('nothing', target, seed).num_features_ for seed in range(2)) <= 1


@pytest.mark.parametrize(
    ('settings', 'options', 'message'),
    [
        ({'target': 'reward'}, {}, "target is 'reward'; expected one of return, decision, action"),
        ({'target': 'action'}, {}, "target is 'action', but the episodes have no actions"),
        ({}, {'action_names': ['a']}, 'there are 1 action_names; expected 0'),
        ({'margin': 1.5}, {}, 'margin is 1.5; expected 0 < margin < 1'),
    ],
)
def test_bad_targets_are_refused_by_name(settings, options, message):
    rng = np.random.default_rng(0)
    data = rng.normal(size=(4, 3, 2)), rng.normal(size=(4, 3))
    with pytest.raises(ValueError, match=message):
        ConditionalMISelector(**settings).fit(data, **options)


def test_actions_of_another_length_or_width_are_refused():
    with pytest.raises(ValueError, match=r'actions has shape \(2, 1\); expected \(3, values\)'):
        Episode(np.zeros((3, 2)), np.zeros(3), np.zeros(2))
    pair = [Episode(np.zeros((3, 2)), np.zeros(3), np.zeros((3, k))) for k in (1, 2)]
    with pytest.raises(ValueError, match='episode 1 has actions of 2 values; expected 1'):
        ConditionalMISelector().fit(pair)


def test_what_the_action_predicts_is_told_apart_from_what_the_sensors_predict():
    rng = np.random.default_rng(0)
    episodes = [
        Episode(states, actions[:, 0] + 0.2 * rng.normal(size=8), actions)
        for states, actions in (
            (rng.normal(size=(8, 2)), rng.normal(size=(8, 1))) for _ in range(40)
        )
    ]
    selector = ConditionalMISelector(target='decision').fit(episodes)
    assert selector.num_features_ == 0
    assert selector.predicted_share_of_none_ == pytest.approx(1 / 1.04, abs=0.06)
    assert selector.predicted_share_of_none_ == selector.predicted_share_


@pytest.mark.parametrize('target', ['return', 'decision'])
def test_rewards_that_never_differ_confirm_nothing(target):
    states = np.random.default_rng(0).normal(size=(10, 5, 2))
    selector = ConditionalMISelector(target=target).fit((states, np.zeros((10, 5))))
    assert selector.num_features_ == 0
    assert selector.predicted_share_ == 0
