# SPDX-License-Identifier: Apache-2.0

"""The search by evidence, with p-values and scores that are given."""

import numpy as np

from cmifs_ros.core.stepwise import StepwiseSelection


class KnownPvalues:
    """A channel has the p-value given (1 of others), whatever else is given.

    A pair has its own, also each given the other; it predicts half of what there is to predict.
    """

    def __init__(self, pvalues, pairs):
        self._pvalues, self._pairs = pvalues, pairs

    def __call__(self, candidates, given):
        def pvalue(channel):
            beside = {channel, *given}
            pairs = [p for pair, p in self._pairs.items() if {channel} < {*pair} <= beside]
            return min([self._pvalues.get(channel, 1.0), *pairs])

        return np.array([min(map(pvalue, candidate)) for candidate in candidates])

    def pair_pvalues(self, channels, given):
        pairs = [[self._pairs.get((a, b), 1.0) for b in channels] for a in channels]
        return np.array(pairs)

    def predicted_share(self, given):
        return 0.5 if any({*pair} <= {*given} for pair in self._pairs) else 0.1


def search(sensors, pvalues, significance=0.05, scores=None, pairs=None):
    def criterion(subsets):
        return np.array([(scores or {}).get(subset[-1], 0.0) for subset in subsets])

    test = KnownPvalues(pvalues, pairs or {})
    return StepwiseSelection(criterion, test, sensors, significance=significance)


def found(sensors, pvalues, **options):
    """Return sensor and channels of what is confirmed."""
    return [(f.sensor, f.channels) for f in search(sensors, pvalues, **options).confirmed()]


def test_a_pvalue_is_corrected_for_the_sensors_that_are_left_not_for_their_channels():
    wide = tuple(range(3, 40))
    assert found([(0,), (1,), (2,), wide], {0: 0.012}) == [(0, (0,))]
    assert found([(0,), (1,), (2,), wide], {0: 0.013}) == []
    # Of the 37 channels of the sensor one alone has to do so much the more.
    assert found([(0,), (1,), (2,), wide], {17: 0.0002}) == [(3, (17,))]
    assert found([(0,), (1,), (2,), wide], {17: 0.0005}) == []


def test_channels_of_a_sensor_that_are_alike_in_what_they_tell_need_no_more_than_one():
    wide = tuple(range(3, 40))
    assert found([(0,), (1,), (2,), wide], dict.fromkeys(wide, 0.012))[0][0] == 3


def test_channels_join_their_sensor_while_they_tell_something():
    pvalues = {1: 1e-6, 4: 1e-4, 5: 0.009, 6: 0.03}
    # 0.009 is one of 4 that are left and 0.03 one of 3: what joins is likely, not the best of many.
    assert found([(0,), (1, 2, 3, 4, 5, 6)], pvalues) == [(1, (1, 4, 5))]
    assert found([(0,), (1, 2, 3, 4, 5, 6)], pvalues, significance=0.1) == [(1, (1, 4, 5, 6))]


def test_the_best_scored_is_first_of_those_with_evidence_as_strong():
    single, scores = [(0,), (1,), (2,), (3,)], {0: 0.1, 1: 0.2, 2: 0.3, 3: 0.9}
    strong = {0: 1e-9, 1: 1e-4}
    order = [sensor for sensor, _ in found(single, strong | {2: 0.01}, scores=scores)]
    assert order == [1, 0, 2]  # 2 scores better but may be redundant; 3 has no evidence
    order = [sensor for sensor, _ in found(single, strong | {2: 1e-5}, scores=scores)]
    assert order == [2, 1, 0]


def test_a_pair_is_corrected_for_the_number_of_pairs_of_different_sensors():
    sensors = [(0,), (1, 2), (3,)]  # of which there are 5, and 2 beside (3,)
    assert found(sensors, {}, pairs={(0, 2): 0.009}) == [(0, (0,)), (1, (2,))]
    assert found(sensors, {}, pairs={(0, 2): 0.011}) == []
    assert found(sensors, {3: 1e-6}, pairs={(0, 2): 0.02}) == [(2, (3,)), (0, (0,)), (1, (2,))]
    assert found(sensors, {}, pairs={(1, 2): 1e-9}) == []


def test_what_listing_costs_grows_with_the_sensors_and_not_with_how_many_are_listed():
    tested, scored = [], []

    def pvalues_of(candidates, given):
        tested.extend(candidates)
        return np.array([0.1 + 0.001 * c for (c,) in candidates])

    def criterion(subsets):
        scored.extend(subsets)
        return np.zeros(len(subsets))

    sensors = [(c,) for c in range(400)]
    listed = StepwiseSelection(criterion, pvalues_of, sensors, significance=0.05).listed([])
    assert sorted(f.sensor for f in listed) == list(range(400))
    # Twice all of them, and eight times the likeliest.
    assert len(tested) <= 2 * 400 + 8 * 50 and len(scored) <= 400 + 8 * 10
