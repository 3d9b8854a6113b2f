# SPDX-License-Identifier: Apache-2.0

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core.search import backward_elimination, forward_selection

WEIGHTS = [3.0, 0.5, 8.0, -1.0]
SENSORS = [(0,), (1,), (2,), (3,)]


def additive(subsets):
    return np.array([sum(WEIGHTS[i] for i in subset) for subset in subsets])


def test_an_additive_criterion_is_ranked_by_its_weights_in_both_directions():
    ranking, scores = forward_selection(additive, SENSORS, 4)
    assert ranking == [2, 0, 1, 3]
    assert scores == [8.0, 11.0, 11.5, 10.5]
    assert backward_elimination(additive, SENSORS) == (ranking, scores)
    assert forward_selection(additive, SENSORS, 2) == (ranking[:2], scores[:2])


def test_backward_elimination_keeps_a_pair_that_counts_only_together():
    def together(subsets):
        return np.array([10.0 * ({0, 1} <= set(s)) + 1.0 * (2 in s) for s in subsets])

    forward, _ = forward_selection(together, SENSORS[:3], 3)
    backward, scores = backward_elimination(together, SENSORS[:3])
    assert forward[0] == 2
    assert backward[2] == 2
    assert scores[1:] == [10.0, 11.0]


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5))
def test_each_forward_step_is_the_best_single_addition(seed, count):
    table = {}
    rng = np.random.default_rng(seed)
    for size in range(1, count + 1):
        for subset in itertools.combinations(range(count), size):
            table[subset] = rng.random()

    def criterion(subsets):
        return np.array([table[tuple(sorted(s))] for s in subsets])

    ranking, scores = forward_selection(criterion, [(i,) for i in range(count)], count)
    assert sorted(ranking) == list(range(count))
    for k, value in enumerate(scores):
        chosen, rest = ranking[:k], ranking[k:]
        assert value == max(table[tuple(sorted([*chosen, i]))] for i in rest)


def test_groups_enter_whole():
    seen = []

    def criterion(subsets):
        seen.extend(map(tuple, subsets))
        return additive(subsets)

    ranking, _ = forward_selection(criterion, [(0, 3), (1,), (2,)], 3)
    assert ranking == [2, 0, 1]
    assert all((0 in s) == (3 in s) for s in seen)


def test_of_equal_scores_the_first_wins():
    ranking, _ = forward_selection(lambda subsets: np.zeros(len(subsets)), SENSORS, 4)
    assert ranking == [0, 1, 2, 3]


@pytest.mark.parametrize('count', [1, 3])
def test_a_search_asks_for_all_candidates_of_a_round_at_once(count):
    rounds = []

    def criterion(subsets):
        rounds.append(len(subsets))
        return additive(subsets)

    forward_selection(criterion, SENSORS, count)
    assert rounds == [4, 3, 2][:count]
