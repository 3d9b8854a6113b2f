# SPDX-License-Identifier: Apache-2.0

"""A sensor matters at the steps at which the world says so."""

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.contribution import contribution
from cmifs_ros.core.selecting import select

NAMES = ('x', 'eye[0]', 'eye[1]', 'noise')
SETTINGS = {'groups': {'eye': NAMES[1:3]}, 'gamma': 0.5}


def make_episodes(seed, paid, acted=None):
    """Return episodes of 1 to 6 steps with rewards, and actions, of the states (T, 4)."""
    rng, episodes = np.random.default_rng(seed), []
    for length in rng.integers(1, 7, size=150):
        states = rng.normal(size=(length, 4))
        noise = 0.1 * rng.normal(size=length)
        actions = None if acted is None else acted(states)
        episodes.append(Episode(states, paid(states) + noise, actions))
    return episodes


def of_steps(episodes, of_states):
    return np.concatenate([of_states(episode.states) for episode in episodes])


def found_in(episodes, target, action_names=()):
    settings = SETTINGS | {'target': target}
    episodes = ConditionalMISelector(**settings).thin(episodes)
    selection = select(episodes, NAMES, 'conditional_mi', settings, action_names=action_names)
    found = contribution(selection, 'eye', episodes, NAMES, action_names=action_names)
    (eye,) = (sensor for sensor in selection.sensors if sensor.name == 'eye')
    return found, eye


def test_the_return_is_higher_by_what_the_sensor_alone_shows():
    # Where x is given, the eye's own part of the reward is this one.
    episodes = make_episodes(0, lambda s: s[:, 0] + 1.5 * s[:, 1] ** 2)
    found, eye = found_in(episodes, 'return')
    assert found.variable == 'return'
    lengths = [len(episode) for episode in episodes]
    np.testing.assert_array_equal(found.episodes, np.repeat(np.arange(150), lengths))
    np.testing.assert_array_equal(found.steps, np.concatenate([np.arange(n) for n in lengths]))
    truth = of_steps(episodes, lambda s: s[:, 1] ** 2)
    assert np.corrcoef(found.values, truth)[0, 1] > 0.95
    assert np.mean(found.values**2) == pytest.approx(eye.effect.share, abs=0.1)


def test_of_several_actions_it_is_the_one_to_which_it_adds_most():
    def acted(states):
        return np.column_stack([states[:, 0], 2 * states[:, 2], states[:, 0]])

    episodes = make_episodes(1, lambda s: s[:, 0], lambda s: acted(s) + 0.5 * s[:, [3]])
    found, _ = found_in(episodes, 'action', ('left', 'right', 'up'))
    assert found.variable == 'right'
    assert np.corrcoef(found.values, of_steps(episodes, lambda s: s[:, 2]))[0, 1] > 0.9


def test_for_a_decision_it_may_be_the_next_value_of_another_sensor():
    rng, episodes = np.random.default_rng(2), []
    for length in rng.integers(1, 7, size=150):
        states = rng.normal(size=(length, 4))
        states[1:, 0] = states[:-1, 1] + 0.1 * states[1:, 0]
        episodes.append(Episode(states, states[:, 0] + 0.1 * rng.normal(size=length)))
    found, eye = found_in(episodes, 'decision')
    assert found.variable == eye.why == 'predicts x'
    truth = [episodes[e].states[s, 1] for e, s in zip(found.episodes, found.steps, strict=True)]
    assert np.corrcoef(found.values, truth)[0, 1] > 0.95
    # The last step of an episode has no next value.
    assert all(s < len(episodes[e]) - 1 for e, s in zip(found.episodes, found.steps, strict=True))
