# SPDX-License-Identifier: Apache-2.0

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.sim import SCENARIOS, GridWorld, preferred_action, rollout, sample_action
from cmifs_ros.sim.grid_world import DOWN, LEFT, RIGHT, UP

X, Y, BATTERY, FOURTH = range(4)


def play(world, actions):
    """Return the states of an episode and its rewards."""
    states, rewards = [world.reset()[0]], []
    for action in actions:
        state, reward, terminated, truncated, info = world.step(action)
        states.append(state)
        rewards.append(reward)
        assert (terminated, info) == (False, {})
        assert truncated == (len(rewards) == 20)
    return np.array(states), np.array(rewards)


def without_gravel_at(column, row):
    world = GridWorld('without_gravel', seed=0)
    world.reset()
    world.column, world.row = column, row
    return world


@given(
    scenario=st.sampled_from(SCENARIOS),
    seed=st.integers(0, 2**32 - 1),
    actions=st.lists(st.integers(0, 3), min_size=20, max_size=20),
)
def test_rules_hold_whatever_the_robot_does(scenario, seed, actions):
    states, rewards = play(GridWorld(scenario, seed=seed), actions)
    x, y, battery = states[:, X], states[:, Y], states[:, BATTERY]
    assert (x[0], battery[0]) == (1, 20)
    assert np.all((x >= 1) & (x <= 10) & (y >= 1) & (y <= 10))
    assert not np.any((x == 5) & (y != 5) & (y != 6))
    assert np.all(np.abs(np.diff(x)) + np.abs(np.diff(y)) <= 1)
    moved = (np.diff(x) != 0) | (np.diff(y) != 0)
    assert not np.any(moved & (battery[:-1] == 0))
    np.testing.assert_array_equal(rewards, np.where(x[1:] == 10, 2.0, 0.0))
    in_gravel = (states[:-1, FOURTH] == 3) & (scenario == 'with_gravel')
    cost = np.where(in_gravel, np.minimum(3, battery[:-1]), moved)
    np.testing.assert_array_equal(-np.diff(battery), cost)


@given(
    seed=st.integers(0, 2**32 - 1), actions=st.lists(st.integers(0, 3), min_size=20, max_size=20)
)
def test_gravel_is_sensed_ahead_and_lasts_four_steps(seed, actions):
    world = GridWorld('with_gravel', seed=seed)
    states, _ = play(world, actions)
    gravel = {(c + 1, r + 1) for c, r in np.argwhere(world.gravel)}
    assert all(2 <= c <= 9 and (c != 5 or r in (5, 6)) for c, r in gravel)
    left = 0
    for before, after in itertools.pairwise(states):
        moved = tuple(before[[X, Y]]) != tuple(after[[X, Y]])
        if left:
            left -= 1
        elif moved and tuple(after[[X, Y]]) in gravel:
            left = 4
        ahead = (after[X] + 1, after[Y]) in gravel
        assert after[FOURTH] == (3 if left else 2 if ahead else 1)


@pytest.mark.parametrize(
    ('start', 'action', 'end'),
    [
        ((4, 1), RIGHT, (4, 1)),  # the wall
        ((4, 5), RIGHT, (5, 5)),  # its gap
        ((4, 6), RIGHT, (5, 6)),
        ((5, 5), UP, (5, 5)),
        ((3, 3), DOWN, (3, 4)),
        ((3, 3), UP, (3, 2)),
        ((3, 3), LEFT, (2, 3)),
        ((1, 1), LEFT, (1, 1)),
        ((10, 10), DOWN, (10, 10)),
    ],
)
def test_moves(start, action, end):
    world = without_gravel_at(*start)
    state = world.step(action).observation
    assert tuple(state[[X, Y]]) == end
    assert state[BATTERY] == 20 - (start != end)


def test_staying_on_the_target_earns_again_and_costs_nothing():
    world = without_gravel_at(10, 3)
    step = world.step(RIGHT)
    assert (step.reward, step.observation[BATTERY]) == (2.0, 20)


def test_noise_channels_are_floored_gaussians_of_their_means():
    # P(floor(N(m, 1)) = k) is the same shape for each integer mean m, with mean m - 0.5.
    states = np.concatenate([e.states for e in rollout('without_gravel', 200, seed=1)])
    noise = states[:, 3:]
    np.testing.assert_array_equal(noise, np.floor(noise))
    np.testing.assert_allclose(noise.mean(axis=0), np.arange(1, 12) - 0.5, atol=0.08)
    np.testing.assert_allclose(noise.var(axis=0), 1 + 1 / 12, atol=0.1)
    assert np.abs(np.corrcoef(noise.T) - np.eye(11)).max() < 0.08


def test_start_rows_are_uniform():
    rows = [e.states[0, Y] for e in rollout('without_gravel', 1000, seed=2)]
    counts = np.bincount(np.array(rows, dtype=int), minlength=11)[1:]
    assert np.sum((counts - 100) ** 2 / 100) < 27.9  # chi-square, 9 degrees, p = 0.001


def test_each_episode_lays_its_own_gravel_on_a_tenth_of_the_cells():
    world = GridWorld('with_gravel', seed=0)
    layouts = []
    for _ in range(200):
        world.reset()
        layouts.append(world.gravel)
    share = np.mean(layouts, axis=0)
    open_cells = share > 0
    assert open_cells.sum() == 8 * 10 - 8
    assert share[open_cells].mean() == pytest.approx(0.1, abs=0.01)
    assert len({layout.tobytes() for layout in layouts}) == 200


@pytest.mark.parametrize(
    ('column', 'row', 'action'),
    [(4, 1, DOWN), (4, 4, DOWN), (4, 5, RIGHT), (4, 6, RIGHT), (4, 7, UP), (4, 10, UP),
     (1, 1, RIGHT), (6, 9, RIGHT)],
)  # fmt: skip
def test_policy_prefers_the_way_through_the_gap(column, row, action):
    state = np.array([column, row, 20.0])
    assert preferred_action(state) == action
    rng = np.random.default_rng(0)
    counts = np.bincount([sample_action(state, rng) for _ in range(4000)], minlength=4) / 4000
    expected = np.full(4, 0.1)
    expected[action] = 0.7
    np.testing.assert_allclose(counts, expected, atol=0.03)


@pytest.mark.parametrize('scenario', SCENARIOS)
def test_the_same_seed_repeats_bit_for_bit_and_another_does_not(scenario):
    def data(seed):
        return [(e.states.tobytes(), e.rewards.tobytes()) for e in rollout(scenario, 5, seed)]

    assert data(7) == data(7)
    assert data(7) != data(8)
    world = GridWorld(scenario)
    first, _ = world.reset(seed=3)
    second, _ = world.reset(seed=3)
    np.testing.assert_array_equal(first, second)


def test_misuse_is_refused_by_name():
    with pytest.raises(ValueError, match="scenario is 'x'; expected one of without_gravel"):
        GridWorld('x')
    world = GridWorld()
    with pytest.raises(RuntimeError, match='call reset'):
        world.step(RIGHT)
    world.reset()
    with pytest.raises(ValueError, match='action is 4'):
        world.step(4)
    for _ in range(20):
        world.step(RIGHT)
    with pytest.raises(RuntimeError, match='call reset'):
        world.step(RIGHT)
