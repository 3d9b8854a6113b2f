# SPDX-License-Identifier: Apache-2.0

import numpy as np

from cmifs_ros.core import ConditionalMISelector, KDRSelector
from cmifs_ros.sim.chain import CHANNEL_NAMES, rollout_chain

S1, S2, S3, S4 = range(4)
SEEDS = range(10)


def test_each_arrow_takes_one_step():
    episodes = rollout_chain(2000, seed=1)
    now = np.concatenate([e.states[:-1] for e in episodes])
    later = np.concatenate([e.states[1:] for e in episodes])
    weights, *_ = np.linalg.lstsq(now, later, rcond=None)
    expected = np.zeros((4, 4))
    expected[S1, S1], expected[S2, S1], expected[S3, S2] = 0.5, 1, 1
    np.testing.assert_allclose(weights, expected, atol=0.05)
    for episode in episodes:
        np.testing.assert_array_equal(episode.rewards, episode.states[:, S1])


def test_the_same_seed_repeats_bit_for_bit_and_another_does_not():
    def data(seed):
        return [episode.states.tobytes() for episode in rollout_chain(5, seed)]

    assert data(7) == data(7)
    assert data(7) != data(8)
    assert rollout_chain(3, 7)[2].states.tobytes() == data(7)[2]


def test_the_return_finds_the_whole_chain():
    for seed in SEEDS:
        selector = ConditionalMISelector(3).fit(rollout_chain(60, seed), names=CHANNEL_NAMES)
        assert set(selector.get_feature_names_out()) == {'s1', 's2', 's3'}, seed


def test_one_step_ahead_of_s1_the_chain_ends_at_s2():
    s3_before_s4 = []
    for seed in SEEDS:
        selector = KDRSelector(target='s1').fit(rollout_chain(60, seed), names=CHANNEL_NAMES)
        ranking = selector.ranking_.tolist()
        assert set(ranking[:2]) == {S1, S2}, seed
        s3_before_s4.append(ranking.index(S3) < ranking.index(S4))
        # What a third channel adds is next to nothing beside what the first two did.
        gains = np.diff(selector.scores_, prepend=0)
        assert gains[2] < 0.05 * gains[1], seed
    # s3 is told from noise no better than by tossing a coin.
    assert 0 < sum(s3_before_s4) < len(SEEDS)
