# SPDX-License-Identifier: Apache-2.0

"""A drive over floor and gravel, and whether the selection finds the vibration.

Gravel slows the robot down, and only the vibration of an IMU distinguishes gravel from floor: its
values are as often above 0 as below. It has 200 messages a second, and the robot file 10 steps:
`over: rms` summarises the messages between two steps. Then the same is done without it, so that the
channel is the newest message alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.program import exit_code

from .example_bag import SECOND, BagWriter, example_parser, select, write_example

ROBOT_FILE = Path(__file__).with_name('gravel.yaml')
_IMU_RATE, _ODOM_RATE = 200, 20
#: Mean length of a patch of floor or gravel, in seconds.
_PATCH = 2.0
#: By whether there is gravel: standard deviation of the acceleration in m/s^2, and the speed in m/s
#: at full throttle.
_SHAKE, _SPEED = (0.5, 1.5), (1.0, 0.5)


def write(bag: BagWriter, seconds: int, seed: int) -> None:
    """Write the messages of a drive."""
    rng = np.random.default_rng(seed)
    point, turn = 'geometry_msgs/msg/Point', 'geometry_msgs/msg/Quaternion'
    unit = bag.message(turn, 0.0, 0.0, 0.0, 1.0)
    vector = 'geometry_msgs/msg/Vector3'
    still = bag.message(vector, 0.0, 0.0, 0.0)
    twist = bag.message('geometry_msgs/msg/Twist', still, still)
    twist = bag.message('geometry_msgs/msg/TwistWithCovariance', twist, np.zeros(36))
    x, throttle, is_gravel = 0.0, 0.7, False
    for tick in range(seconds * _IMU_RATE):
        time = 100 * SECOND + tick * SECOND // _IMU_RATE
        is_gravel ^= bool(rng.random() < 1 / (_PATCH * _IMU_RATE))
        x += throttle * _SPEED[is_gravel] / _IMU_RATE
        shaking = bag.message(vector, *rng.normal(0, _SHAKE[is_gravel], size=3))
        none = np.zeros(9)
        bag.write('/imu', time, 'sensor_msgs/msg/Imu', bag.header(time), unit, none, still, none,
                  shaking, none)  # fmt: skip
        if tick % (_IMU_RATE // _ODOM_RATE) == 0:
            throttle = float(np.clip(throttle + rng.normal(0, 0.05), 0.4, 1.0))
            pose = bag.message('geometry_msgs/msg/Pose', bag.message(point, x, 0.0, 0.0), unit)
            pose = bag.message('geometry_msgs/msg/PoseWithCovariance', pose, np.zeros(36))
            bag.write('/odom', time, 'nav_msgs/msg/Odometry', bag.header(time), 'base', pose, twist)
            bag.write('/throttle', time, 'std_msgs/msg/Float64', throttle)
        if tick % _IMU_RATE == 0:
            charge = 1 - tick / _IMU_RATE / 3600 + rng.normal(0, 0.01)
            bag.write('/battery', time, 'std_msgs/msg/Float64', charge)


def main(arguments: list[str] | None = None) -> int:
    """Run the example; return the exit code."""
    parser = example_parser('gravel', __doc__)
    parser.add_argument('--seconds', type=number_from(60), default=300, help='default 300')
    options = parser.parse_args(arguments)

    def run() -> None:
        bag = write_example(lambda bag: write(bag, options.seconds, options.seed), options.out)
        select(bag, ROBOT_FILE, options.out)
        print('\nThe same with the newest message alone:\n')
        newest = options.out / 'newest.yaml'
        newest.write_text(ROBOT_FILE.read_text().replace(', over: rms', ''))
        select(bag, newest, options.out / 'newest')

    return exit_code('gravel', run, 'nothing more is written')


if __name__ == '__main__':
    sys.exit(main())
