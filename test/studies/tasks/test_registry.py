# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from cmifs_ros.core import Episode
from studies.methods.registry import METHODS, rank, what_is_missing
from studies.tasks.fixed_gravel import FixedGravelWorld
from studies.tasks.registry import TASKS


def samples(name, num_episodes, seed=1):
    """Return the states and the rewards of all steps, and the index of each channel."""
    episodes = TASKS[name].rollout(num_episodes, seed)
    states = np.concatenate([e.states for e in episodes])
    rewards = np.concatenate([e.rewards for e in episodes])
    return states, rewards, {n: i for i, n in enumerate(TASKS[name].channel_names)}


def test_the_point_robot_pays_for_its_distance_and_an_empty_battery():
    episodes = TASKS['point_robot'].rollout(40, 1)
    assert {len(e) for e in episodes} <= set(range(60, 101))
    assert len({len(e) for e in episodes}) > 10
    x, y, _, _, battery = np.concatenate([e.states for e in episodes]).T[:5]
    expected = -np.sqrt(x**2 + y**2) - np.where(battery < 20, 1, 0)
    np.testing.assert_allclose(np.concatenate([e.rewards for e in episodes]), expected)
    assert 0.1 < np.mean(battery < 20) < 0.5
    states = episodes[0].states
    assert np.isin(np.round(np.diff(states[:, 4]), 6), (-0.1, 0)).all()
    # At 50 Hz: what the velocity says is what the position does, within a step's push.
    np.testing.assert_allclose(np.diff(states[:, 0]), 0.02 * states[1:, 2], atol=1e-9)


def test_two_switches_matter_only_together():
    states, rewards, index = samples('two_switches', 400)
    a, b = states[:, index['a']], states[:, index['b']]
    assert max(abs(np.corrcoef(s, rewards)[0, 1]) for s in (a, b)) < 0.2
    assert np.corrcoef(a != b, rewards)[0, 1] > 0.99


def test_wild_readings_are_as_rare_as_they_are_said_to_be():
    states, _, _ = samples('wild_readings', 400)
    assert np.mean(states[:, 0] == 65535) == pytest.approx(0.02, abs=0.01)
    assert (samples('one_wild_reading', 60)[0] == 65535).sum() == 1


def test_a_motor_warms_up_while_the_policy_improves():
    episodes = TASKS['drift'].rollout(40, 1)
    temperature, paid = np.array([(e.states[:, 0].mean(), e.rewards.mean()) for e in episodes]).T
    assert np.corrcoef(temperature, paid)[0, 1] > 0.8
    # Within an episode it says nothing.
    residue = [np.corrcoef(e.states[:, 0], e.rewards)[0, 1] for e in episodes]
    assert abs(np.mean(residue)) < 0.2


def test_what_wanders_does_so_by_itself_from_episode_to_episode():
    episodes = TASKS['wandering'].rollout(2000, 1)
    means = np.array([(*e.states[:, :3].mean(axis=0), e.rewards.mean()) for e in episodes])
    for column in means.T:
        assert np.corrcoef(column[1:], column[:-1])[0, 1] > 0.7
    assert np.abs(np.corrcoef(means.T) - np.eye(4)).max() < 0.25
    few = TASKS['wandering'].rollout(3, 1)
    assert all(np.array_equal(a.states, b.states) for a, b in zip(few, episodes, strict=False))


def test_the_lidar_sees_what_the_robot_then_hits():
    pytest.importorskip('irsim', reason='ir-sim is not here')
    task = TASKS['lidar_world']
    episodes = task.rollout(30, 1)
    ends = [e.rewards[-1] for e in episodes]
    assert {-1.0, 1.0} <= set(ends) <= {-1.0, 0.0, 1.0}
    assert all((e.rewards[:-1] == 0).all() for e in episodes)
    rays = list(task.sensors['lidar'])
    assert len(rays) == len(task.sensors['other_lidar']) == 12
    nearest = {
        end: np.mean([e.states[-1, rays].min() for e, last in zip(episodes, ends, strict=True)
                      if last == end])
        for end in (-1.0, 1.0)
    }  # fmt: skip
    assert nearest[-1] < 1 < nearest[1]
    assert all(
        np.hypot(*(e.states[-1, :2] - (9, 5))) < 1.5
        for e, last in zip(episodes, ends, strict=True)
        if last == 1
    )


def test_sensors_are_counted_as_the_selector_counts_them():
    task = TASKS['one_of_twelve']
    assert task.sensor_names == ('scan', 'x', 'noise_1', 'noise_2', 'noise_3')
    assert task.sensors['scan'] == tuple(range(12))
    assert task.sensors['x'] == (12,)
    assert task.relevant == (0, 1)
    assert (task.optimum, task.chance) == (3, 6)


@pytest.mark.parametrize(
    'method', ['default', 'paper', 'kdr', 'sklearn', 'ennemi', 'forest', 'boruta', 'direct_port']
)
def test_every_method_ranks_sensors(method):
    assert method in METHODS
    if what_is_missing(method):
        pytest.skip(what_is_missing(method))
    rng = np.random.default_rng(0)
    episodes = [Episode(s, s[:, 3]) for s in rng.normal(size=(40, 2, 5))]
    sensors = {'a': (0,), 'b': (1, 3), 'c': (2,), 'd': (4,)}
    ranking = rank(method, episodes, target=(3,), seed=0, sensors=sensors)
    assert sorted(ranking.channels) == [0, 1, 2, 3]
    assert len(ranking.scores) == 4
    if method in ('sklearn', 'ennemi', 'forest', 'boruta'):
        assert ranking.channels[0] == 1
    assert rank(
        method, episodes, target=(3,), seed=0, sensors=sensors, num_features=2
    ).channels == ranking.channels[:2]  # fmt: skip


def test_fixed_gravel_lies_where_it_lay_in_the_first_episode():
    world = FixedGravelWorld('with_gravel', seed=0)
    world.reset()
    first = world.gravel.copy()
    assert first.any()
    for _ in range(5):
        world.reset()
        np.testing.assert_array_equal(world.gravel, first)
