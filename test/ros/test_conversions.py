import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cmifs_ros.ros import conversions
from cmifs_ros.ros.transitions import RewardSample


@pytest.mark.parametrize('nanoseconds', [0, 1, 999_999_999, 1_000_000_000, 2**62 // 10**9 * 10**9])
def test_stamps_survive_the_round_trip(nanoseconds):
    nanoseconds = min(nanoseconds, (2**31 - 1) * 10**9)
    stamp = conversions.stamp_from_nanoseconds(nanoseconds)
    assert conversions.stamp_to_nanoseconds(stamp) == nanoseconds


def test_rewards_survive_the_round_trip():
    sample = RewardSample(2.5, True, False, 12, 3)
    msg = conversions.reward_sample_to_msg(Header(), sample, action=1)
    assert conversions.reward_sample(msg) == sample


def test_only_the_reward_is_required():
    msg = JointState(name=['reward'], position=[2.0])
    assert conversions.reward_sample(msg) == RewardSample(2.0)


@pytest.mark.parametrize(
    ('names', 'values', 'message'),
    [
        (['reward'], [], '0 positions for 1 names'),
        (['step'], [1.0], 'fields are step; expected reward among them'),
        ([], [], 'fields are none'),
        (['reward'], [np.nan], 'reward is nan; expected a finite number'),
        (['reward', 'step'], [1.0, np.inf], 'step is inf'),
    ],
)
def test_an_unusable_reward_is_refused_by_name(names, values, message):
    with pytest.raises(ValueError, match=message):
        conversions.reward_sample(JointState(name=names, position=values))


def test_the_map_has_column_and_row_as_x_and_y():
    walls = np.zeros((3, 2), dtype=bool)
    gravel = np.zeros((3, 2), dtype=bool)
    walls[2, 0] = gravel[0, 1] = True
    grid = conversions.grid_to_msg(Header(), walls, gravel)
    assert (grid.info.width, grid.info.height) == (3, 2)
    assert list(grid.data) == [0, 0, 100, 50, 0, 0]
