# SPDX-License-Identifier: Apache-2.0

import pytest

from cmifs_ros.collect.episodes.reward_check import problem_of_target
from cmifs_ros.core import ConditionalMISelector, Episode


def episodes(*rewards):
    return [Episode([[float(i)]] * len(r), r) for i, r in enumerate(rewards)]


def thinned_of(rewards):
    return ConditionalMISelector(gamma=0.9).thin(episodes(*rewards))


@pytest.mark.parametrize(
    ('rewards', 'said'),
    [
        ([[-1] * 3, [-1] * 3], 'every reward is -1, in all 2 episodes: no return differs'),
        ([[0] * 3, [0] * 5, [0]], 'every reward is 0, in all 3 episodes: no return differs'),
        ([[0.1 + 0.2] * 2, [0.3] * 2], 'every reward is 0.3'),
        ([[0, 1, 0], [0, 1]], 'the rewards repeat exactly, in all 2 episodes'),
    ],
)
def test_rewards_by_which_no_return_differs_are_told_with_a_remedy(rewards, said):
    problem = problem_of_target(episodes(*rewards), 'return')
    assert problem_of_target(thinned_of(rewards), 'return') == problem
    assert problem.startswith(said)
    assert '`reward` in the robot file' in problem


@pytest.mark.parametrize(
    'rewards',
    [
        [[-1] * 3, [-1] * 4],  # how soon it ends is what differs
        [[0, 0, 1], [0, 1]],  # how soon the goal is reached
        [[0, 0, 0], [0, 0, 1]],
        [[0, 1], [0, 1, 1]],
        [[1e308, 0], [-1e308, 0]],
    ],
)
def test_where_a_return_differs_there_is_no_problem(rewards):
    assert problem_of_target(episodes(*rewards), 'return') == ''
    assert problem_of_target(thinned_of(rewards), 'return') == ''


def test_the_action_as_target_needs_actions_and_no_reward():
    constant = [[1.0, 1.0], [1.0, 1.0]]
    assert problem_of_target(episodes(*constant), 'decision').startswith('every reward is 1')
    problem = problem_of_target(episodes(*constant), 'action')
    assert problem.startswith("target is 'action', but the episodes have no actions: add `actions`")
    acting = [Episode(e.states, e.rewards, e.rewards) for e in episodes(*constant)]
    assert problem_of_target(acting, 'action') == ''
