# SPDX-License-Identifier: Apache-2.0

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('gymnasium')

import gymnasium
from gymnasium import spaces

from cmifs_ros.sim.gymnasium_episodes import (
    action_names,
    channel_names,
    collect_episodes,
    named_action,
    select_channels,
)


class Rooms(gymnasium.Env):
    """A Dict space; pays what its second part says."""

    observation_space = gymnasium.spaces.Dict(
        {
            'pose': gymnasium.spaces.Box(-1, 1, (2,)),
            'battery': gymnasium.spaces.Box(0, 1, (1,)),
        }
    )
    action_space = gymnasium.spaces.Discrete(3)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self.observe(), {}

    def observe(self):
        return {'pose': self.np_random.random(2), 'battery': np.array([self.np_random.random()])}

    def step(self, action):
        self.steps += 1
        return self.observe(), float(action), False, self.steps == 5, {}


def test_channels_are_named_by_keys_by_structure_or_by_number():
    assert channel_names(Rooms()) == ('battery', 'pose_0', 'pose_1')
    assert channel_names(gymnasium.make('Pendulum-v1')) == ('obs_0', 'obs_1', 'obs_2')


def test_mujoco_environments_tell_the_structure_of_what_they_observe():
    pytest.importorskip('mujoco', reason='mujoco is not here')
    names = channel_names(gymnasium.make('InvertedPendulum-v5'))
    assert names == ('qpos_0', 'qpos_1', 'qvel_0', 'qvel_1')


def test_an_episode_holds_what_was_seen_before_each_step_and_paid_after_it():
    seen = []

    def policy(observation):
        seen.append(observation)
        return len(seen) % 3

    episodes = collect_episodes(Rooms(), 2, policy, seed=4)
    assert [len(e) for e in episodes] == [5, 5]
    assert [r for e in episodes for r in e.rewards] == [(i + 1) % 3 for i in range(10)]
    column = channel_names(Rooms()).index('battery')
    batteries = [s for e in episodes for s in e.states[:, column]]
    assert batteries == [float(o['battery'][0]) for o in seen]


def test_an_episode_holds_the_actions_that_were_taken_each_as_a_category():
    numbers = iter([0, 2, 2, 1, 0])
    (episode,) = collect_episodes(Rooms(), 1, lambda observation: next(numbers), seed=4)
    assert action_names(Rooms()) == ('action.0', 'action.1', 'action.2')
    expected = [[1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [1, 0, 0]]
    np.testing.assert_array_equal(episode.actions, expected)


def test_continuous_actions_are_kept_as_they_are():
    torques = iter(np.array([[0.5], [-1.25], [2.0]], np.float32))
    env = gymnasium.make('Pendulum-v1')
    (episode,) = collect_episodes(env, 1, lambda observation: next(torques), max_steps=3, seed=4)
    assert action_names(env) == ('action',)
    np.testing.assert_array_equal(episode.actions, [[0.5], [-1.25], [2.0]])


def test_the_names_of_actions_do_not_change_what_is_drawn():
    env = gymnasium.make('Pendulum-v1')
    (first,) = collect_episodes(env, 1, max_steps=5, seed=3)
    env.action_space.seed(3)
    action_names(env)
    np.testing.assert_array_equal(first.actions[0], env.action_space.sample())


@pytest.mark.parametrize(
    ('space', 'action', 'expected'),
    [
        (spaces.Discrete(2, start=5), 6, {'action.5': 0, 'action.6': 1}),
        (
            spaces.MultiDiscrete([2, 2]),
            [1, 0],
            {'action_0.0': 0, 'action_0.1': 1, 'action_1.0': 1, 'action_1.1': 0},
        ),
        (spaces.Box(-1, 1, (2, 1)), [[0.5], [-0.5]], {'action_0': 0.5, 'action_1': -0.5}),
        (spaces.MultiBinary(2), [1, 0], {'action_0': 1, 'action_1': 0}),
        (
            spaces.Dict(arm=spaces.Box(-1, 1), grip=spaces.Tuple([spaces.Discrete(2)])),
            {'arm': [0.25], 'grip': (1,)},
            {'action_arm': 0.25, 'action_grip_0.0': 0, 'action_grip_0.1': 1},
        ),
        (spaces.Text(4), 'stop', {}),
    ],
)
def test_actions_of_any_space_are_numbers_with_names(space, action, expected):
    assert named_action(space, action) == expected
    assert action_names(SimpleNamespace(action_space=space)) == tuple(expected)


def test_an_environment_without_an_action_space_gives_no_actions():
    class Bare(Rooms):
        action_space = None

    (episode,) = collect_episodes(Bare(), 1, lambda observation: 1, seed=4)
    assert episode.actions.shape == (5, 0)
    assert action_names(Bare()) == ()


def test_the_same_seed_repeats_and_endless_episodes_are_cut():
    env = gymnasium.make('Pendulum-v1').unwrapped  # without its limit of steps
    first, again, other = (collect_episodes(env, 2, max_steps=7, seed=s) for s in (3, 3, 4))
    assert [len(e) for e in first] == [7, 7]
    assert [e.states.tobytes() for e in first] == [e.states.tobytes() for e in again]
    assert first[1].states.tobytes() != first[0].states.tobytes()
    assert first[0].states.tobytes() != other[0].states.tobytes()


def test_the_wrapper_leaves_the_selected_channels_in_their_order():
    env = gymnasium.make('Pendulum-v1')
    whole, _ = env.reset(seed=1)
    selected = select_channels(env, np.array(['obs_2', 'obs_0']))  # as a selector gives them
    part, _ = selected.reset(seed=1)
    np.testing.assert_allclose(part, whole[[2, 0]])
    assert part in selected.observation_space
    assert channel_names(selected) == ('obs_0', 'obs_1')


@pytest.mark.parametrize('names', [[], ['speed']])
def test_unknown_channels_are_one_clear_sentence(names):
    with pytest.raises(ValueError, match='expected at least one of obs_0, obs_1, obs_2'):
        select_channels(gymnasium.make('Pendulum-v1'), names)


def test_no_episode_is_refused():
    with pytest.raises(ValueError, match='num_episodes is 0; expected at least 1'):
        collect_episodes(Rooms(), 0)
