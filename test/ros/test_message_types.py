# SPDX-License-Identifier: Apache-2.0

"""Messages of many types: live and from a bag they give the same numbers, and the right ones."""

from math import cos, inf, pi, sin

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')
pytest.importorskip('rosbags', reason='rosbags is not here')

import diagnostic_msgs.msg as diagnostic
import geometry_msgs.msg as geometry
import nav_msgs.msg as nav
import sensor_msgs.msg as sensor
import std_msgs.msg as std
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore

from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.sampler import SECOND, Sampler

STORE = get_typestore(Stores.ROS2_JAZZY)
HEADER = std.Header(stamp=Time(sec=7, nanosec=5), frame_id='base')
TURN = geometry.Quaternion(z=sin(pi / 6), w=cos(pi / 6))
POSE = geometry.Pose(position=geometry.Point(x=1.5, y=-2.5), orientation=TURN)
TWIST = geometry.Twist(linear=geometry.Vector3(x=0.25), angular=geometry.Vector3(z=-0.5))
STATUS = diagnostic.DiagnosticStatus(
    level=b'\x01', name='arm: /motors, left',
    values=[diagnostic.KeyValue(key='Heat (C)', value='36.5'), diagnostic.KeyValue(key='n')],
)  # fmt: skip
VECTOR = geometry.Vector3(x=0.5, y=1.0, z=9.75)
CASES = [
    (nav.Odometry(header=HEADER, pose=geometry.PoseWithCovariance(pose=POSE)),
     {'.pose.pose.position.x': [1.5], '.pose.pose.position.y': [-2.5],
      '.pose.covariance[0:36:7]': [0.0] * 6}),
    (geometry.PoseStamped(header=HEADER, pose=POSE), {'.pose.position.y': [-2.5]}),
    (geometry.TwistStamped(header=HEADER, twist=TWIST),
     {'.twist.linear.x': [0.25], '.twist.angular.z': [-0.5]}),
    (sensor.Imu(header=HEADER, linear_acceleration=VECTOR, angular_velocity=VECTOR),
     {'.linear_acceleration.z': [9.75], '.angular_velocity.x': [0.5]}),
    (sensor.LaserScan(header=HEADER, range_max=8.0, ranges=[1.0, inf, 3.0, 4.5]),
     {'.ranges[0:4:2]': [1.0, 3.0], '.ranges[3]': [4.5], '.range_max': [8.0]}),
    (sensor.BatteryState(header=HEADER, percentage=0.5, power_supply_status=2, present=True),
     {'.percentage': [0.5], '.power_supply_status': [2.0], '.present': [1.0]}),
    # With empty arrays serialize_message, unlike the middleware, leaves bytes at the end.
    (sensor.JointState(header=HEADER, name=['a', 'b', 'c'], position=[1.0, 2.0, 3.0],
                       velocity=[0.0] * 3, effort=[0.0] * 3),
     {'.position{c,a}': [3.0, 1.0], '.position[1]': [2.0]}),
    (sensor.NavSatFix(header=HEADER, latitude=52.5, longitude=13.25, altitude=34.0),
     {'.latitude': [52.5], '.longitude': [13.25], '.status.status': [-2.0]}),
    (sensor.Range(header=HEADER, range=0.75), {'.range': [0.75]}),
    (sensor.Temperature(header=HEADER, temperature=36.5), {'.temperature': [36.5]}),
    (sensor.Joy(header=HEADER, axes=[0.5, -1.0], buttons=[0, 1, 0]),
     {'.axes[0:2]': [0.5, -1.0], '.buttons[1]': [1.0]}),
    (diagnostic.DiagnosticArray(header=HEADER, status=[diagnostic.DiagnosticStatus(), STATUS]),
     {'.status{arm: /motors, left}.values{Heat (C)}.value': [36.5],
      '.status{arm: /motors, left}.level': [1.0]}),
    (std.Bool(data=True), {'.data': [1.0]}),
    (std.Byte(data=b'\x03'), {'.data': [3.0]}),
    (std.UInt8(data=200), {'.data': [200.0]}),
    (std.Int32(data=-7), {'.data': [-7.0]}),
    (std.Float32(data=0.5), {'.data': [0.5]}),
    (std.Float64(data=0.1), {'.data': [0.1]}),
    (std.Float32MultiArray(data=[1.0, 2.0, 3.0]), {'.data[0:3:2]': [1.0, 3.0]}),
]  # fmt: skip


def state_of(robot, message):
    """Return the time and the values of a step at a message."""
    sampler = Sampler(robot)
    sampler.add('/t', message, 9 * SECOND)
    sampler.flush()
    assert not sampler.wrong
    stamp, state = sampler._left[:2]
    return stamp, list(state)


@pytest.mark.parametrize(('message', 'fields'), CASES, ids=lambda case: type(case).__name__)
def test_live_and_from_a_bag_a_message_gives_the_same_numbers(message, fields):
    channels = ''.join(f'  c{i}: "/t{path}"\n' for i, path in enumerate(fields))
    robot = parse_robot_file(f'step: {{topic: /t}}\nchannels:\n{channels}reward: "1"\n')
    kind = f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
    recorded = STORE.deserialize_cdr(serialize_message(message), kind)
    expected = [value for values in fields.values() for value in values]
    stamp = 7 * SECOND + 5 if hasattr(message, 'header') else 9 * SECOND
    assert state_of(robot, message) == (stamp, expected)
    assert state_of(robot, recorded) == (stamp, expected)


@pytest.mark.parametrize('message', [CASES[0][0], CASES[1][0]], ids=['Odometry', 'PoseStamped'])
def test_the_yaw_of_a_quaternion(message):
    path = '/t.pose.pose.orientation' if isinstance(message, nav.Odometry) else (
        '/t.pose.orientation')  # fmt: skip
    robot = parse_robot_file(
        f'step: {{topic: /t}}\nchannels: {{yaw: {{path: {path}, as: yaw}}}}\nreward: "1"\n'
    )
    assert state_of(robot, message)[1] == pytest.approx([sin(pi / 3), cos(pi / 3)])
