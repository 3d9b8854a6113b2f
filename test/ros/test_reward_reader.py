# SPDX-License-Identifier: Apache-2.0

from array import array

import numpy as np
import pytest
from std_msgs.msg import Header

from cmifs_ros.collect.discount import Discount
from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.reward_reader import RewardReader
from cmifs_ros.ros import conversions


def test_rewards_survive_the_round_trip():
    sample = RewardSample(2.5, True, False, 12, 3)
    msg = conversions.reward_sample_to_msg(Header(), sample, action=1)
    assert RewardReader().sample_of(msg.name, msg.position) == sample


def test_only_the_reward_is_required():
    assert RewardReader().sample_of(['reward'], array('d', [2])) == RewardSample(2.0)


@pytest.mark.parametrize(
    ('names', 'values', 'message'),
    [
        (['reward'], [], '0 positions for 1 name'),
        (['step'], [1.0], 'fields are step; expected reward among them'),
        ([], [], 'fields are none'),
        (['reward'], [np.nan], 'reward is nan; expected a finite number'),
        (['reward', 'step'], [1.0, np.inf], 'step is inf'),
        (['reward', 'step'], [-np.inf, np.inf], 'reward is -inf'),
    ],
)
def test_an_unusable_reward_is_refused_by_name(names, values, message):
    with pytest.raises(ValueError, match=message):
        RewardReader().sample_of(names, array('d', values))


def test_fields_may_change_their_order_and_come_and_go():
    reader = RewardReader()
    for names, values, sample in (
        (['reward', 'step'], [2, 3], RewardSample(2.0, step=3)),
        (['step', 'reward'], [4, 5], RewardSample(5.0, step=4)),
        (['reward', 'other', 'truncated'], [6, 7, 1], RewardSample(6.0, truncated=True)),
        (['reward'], [8], RewardSample(8.0)),
    ):
        assert reader.sample_of(names, array('d', values)) == sample


def test_huge_rewards_are_finite_though_their_sum_is_not():
    sample = RewardReader().sample_of(['reward', 'action', 'step'], array('d', [1e308, 1e308, 1]))
    assert sample == RewardSample(1e308, step=1)


def test_a_discount_may_stand_beside_the_reward():
    reader = RewardReader()
    for names, values, discount in (
        (['reward'], [1], None),
        (['reward', 'half_life'], [1, 20], Discount(half_life=20.0)),
        (['gamma', 'reward'], [0.9, 1], Discount(0.9)),
    ):
        assert reader.sample_of(names, array('d', values)).reward == 1
        assert reader.discount == discount


def test_a_target_may_stand_beside_the_reward():
    reader = RewardReader()
    assert reader.target is None
    for number, target in enumerate(('return', 'decision', 'action')):
        reader.sample_of(['reward', 'target'], array('d', [1, number]))
        assert reader.target == target
    reader.sample_of(['reward'], array('d', [1]))
    assert reader.target == 'action'  # As of the newest message that has one.
    for wrong in (3, 0.5, -1):
        with pytest.raises(
            ValueError, match=r'expected 0 \(return\), 1 \(decision\), 2 \(action\)'
        ):
            reader.sample_of(['reward', 'target'], array('d', [1, wrong]))
