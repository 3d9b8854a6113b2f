import numpy as np
import pytest

pytest.importorskip('gymnasium')

import gymnasium

from cmifs_ros.sim.gymnasium_episodes import (
    channel_names,
    collect_episodes,
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
