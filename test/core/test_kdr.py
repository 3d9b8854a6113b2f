# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from oracles import direct_kdr

from cmifs_ros.core import KDR, Episode, KDRSelector
from cmifs_ros.core.kdr import median_distance

SUBSETS = [(0,), (2,), (1, 2), (3, 0, 1), (0, 1, 2, 3)]


def chained(lengths=(6,) * 25, seed=0):
    """Return episodes in which channel 1 is, with some noise, what channel 2 was a step before."""
    rng = np.random.default_rng(seed)
    episodes = []
    for length in lengths:
        states = rng.normal(size=(length, 4))
        states[1:, 1] = states[:-1, 2] + 0.3 * states[1:, 1]
        episodes.append(Episode(states, np.zeros(length)))
    return episodes


def score(episodes, subsets=SUBSETS, target=(1,)):
    return KDR(episodes, target, random_state=0)(subsets)


@pytest.mark.parametrize('lengths', [(4,) * 12, (1, 2, 2, 3, 3, 3, 3, 4, 4, 5)])
@pytest.mark.parametrize('target', [(1,), (0, 3)])
def test_it_is_the_literal_formula_counted_from_the_empty_subset(lengths, target):
    episodes = chained(lengths)
    states = [episode.states for episode in episodes]
    empty = direct_kdr(states, target, ())
    expected = [empty - direct_kdr(states, target, subset) for subset in SUBSETS]
    np.testing.assert_allclose(score(episodes, target=target), expected, rtol=1e-9)
    assert score(episodes, [()], target) == pytest.approx([0], abs=1e-9)


def test_the_order_of_episodes_does_not_matter():
    episodes = chained((6, 5, 7, 3, 6, 6, 4, 6))
    order = [3, 1, 7, 0, 2, 6, 5, 4]
    np.testing.assert_allclose(score([episodes[i] for i in order]), score(episodes), rtol=1e-10)


def test_the_order_of_channels_does_not_matter():
    episodes, order = chained(), [3, 1, 0, 2]
    permuted = [Episode(e.states[:, order], e.rewards) for e in episodes]
    subsets = [[order.index(i) for i in subset] for subset in SUBSETS]
    np.testing.assert_allclose(
        score(permuted, subsets, target=[order.index(1)]), score(episodes), rtol=1e-10
    )


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('direction', ['forward', 'backward'])
def test_the_direct_cause_ranks_first(seed, direction):
    selector = KDRSelector(1, target='b', direction=direction)
    selector.fit(chained(seed=seed), names=['a', 'b', 'c', 'd'])
    assert selector.get_feature_names_out().tolist() == ['c']


def test_without_a_number_all_sensors_are_ranked_and_selected():
    selector = KDRSelector(target=np.int64(1), groups={'pair': [0, 3]}).fit(chained())
    assert selector.sensor_names_ == ('pair', 'x1', 'x2')
    assert sorted(selector.ranking_) == [0, 1, 2]
    assert selector.num_features_ == 3
    assert np.all(np.diff([0, *selector.scores_]) > 0)


def test_the_same_seed_gives_the_same_bits_also_where_the_width_is_of_a_sample():
    episodes = chained((300,) * 8)
    one, other, third = (
        KDR(episodes, [1], random_state=seed)([(2,), (0, 1)]) for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(third, one, rtol=0.05)
    assert not np.array_equal(third, one)


def test_the_width_is_the_median_distance_and_ties_do_not_make_it_0():
    assert median_distance(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0]]), 0) == 5.0
    assert median_distance(np.array([[0.0]] * 9 + [[2.0]]), 0) == 2.0
    assert median_distance(np.zeros((5, 2)), 0) == 1.0


@pytest.mark.parametrize('what', ['constant channel', 'constant everything', 'huge values'])
def test_degenerate_data_give_finite_scores(what):
    episodes = chained()
    factor = {'constant channel': [0, 1, 1, 1], 'constant everything': 0, 'huge values': 1e150}
    changed = [Episode(7 + e.states * factor[what], e.rewards) for e in episodes]
    scores = score(changed)
    assert np.isfinite(scores).all()
    if what != 'huge values':
        assert scores[0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ('target', 'message'),
    [
        ('q', "target names channel 'q'; expected one of a, b, c, d"),
        (['a', 4], 'target names channel 4; expected one of a, b, c, d'),
        ([], r'target is \[\]; expected at least one channel'),
    ],
)
def test_bad_targets_are_refused_by_name(target, message):
    with pytest.raises(ValueError, match=message):
        KDRSelector(target=target).fit(chained(), names=['a', 'b', 'c', 'd'])


def test_a_step_ahead_has_to_exist():
    with pytest.raises(ValueError, match=r'have \[1, 1, 5\] steps; expected at least two episodes'):
        KDRSelector(target=0).fit(chained((1, 1, 5)))
