# SPDX-License-Identifier: Apache-2.0

"""The processes of `make saving`: `robot`, `lidar` and `control`.

`robot GOALS CHANGE_AT SEED SPEED` drives to goals as `control` commands, which looks at
`selected_state` alone. After CHANGE_AT goals the task is another one: a hot motor may fail.
`lidar SEED SPEED` is the driver of another robot's lidar, which is idle while nobody subscribes.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import time

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import (
    QoSProfile,
    qos_profile_action_status_default,
    qos_profile_sensor_data,
)
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu, JointState, LaserScan, Temperature
from std_msgs.msg import Header

from cmifs_ros.ros.qos import STREAM_QOS
from cmifs_ros.ros.run_node import make_executor
from studies.tasks.lidar_world import GOAL, MAX_STEPS, NUM_RAYS, SPEED, STEP_SECONDS, LidarWorld

from .drive import scan_of

#: Rays of the other lidar, of which the robot file takes every 30th.
NUM_OTHER_RAYS = 360
_REST = 3  # steps between two goals
#: How much the commands of `control` are disturbed, and how far it keeps from obstacles in m.
_NOISE, _CLEARANCE, _REPULSION = 0.7, 1.0, 0.3
_ANGLES = np.linspace(-np.pi, np.pi, NUM_RAYS)
#: Above how many degrees the motor fails, once the task has changed, in this share of the steps.
_HOT, _FAILS = 50.0, 0.1
#: The status of a goal by its reward.
_STATUSES = {
    1.0: GoalStatus.STATUS_SUCCEEDED,
    -1.0: GoalStatus.STATUS_ABORTED,
    0.0: GoalStatus.STATUS_CANCELED,
}


class Robot:
    """Drive and publish, a step at each call."""

    def __init__(self, node, num_goals: int, change_at: int, seed: int):
        self._rng = np.random.default_rng(seed)
        self._world = LidarWorld(self._rng)
        self._num_goals, self._change_at = num_goals, change_at
        self._observation, self._motor = self._world.reset(), 0.0
        self._status = GoalStatus(status=GoalStatus.STATUS_UNKNOWN)
        self._goal, self._since, self._command = 0, 0, np.zeros(2)
        self._publishers = {
            kind: node.create_publisher(kind, topic, qos)
            for kind, topic, qos in (
                (LaserScan, '/scan', qos_profile_sensor_data),
                (Temperature, '/motor', qos_profile_sensor_data),
                (Imu, '/imu', qos_profile_sensor_data),
                (GoalStatusArray, '/go_to/_action/status', qos_profile_action_status_default),
                (Odometry, '/odom', QoSProfile(depth=10)),
            )
        }
        node.create_subscription(Twist, '/cmd_vel', self._on_command, 10)
        self._clock = node.get_clock()

    @property
    def is_heard(self) -> bool:
        """Whether somebody subscribes to what a step is."""
        return self._publishers[Odometry].get_subscription_count() > 0

    def _on_command(self, command: Twist) -> None:
        self._command = np.array([command.linear.x, command.linear.y])

    def step(self) -> bool:
        """Live for a step; return whether there are more goals."""
        self._since += 1
        reward = None
        if self._status.status == GoalStatus.STATUS_EXECUTING:
            reward = self._drive()
        self._publish()
        if reward is not None:
            self._end(reward)
        elif self._status.status != GoalStatus.STATUS_EXECUTING and self._since >= _REST:
            if self._goal == self._num_goals:
                return False
            self._begin()
        return True

    def _drive(self) -> float | None:
        """Return the reward of the goal, None while it is under way."""
        velocity = self._command + self._rng.normal(0, _NOISE, 2)
        self._observation, reward, has_ended = self._world.move(velocity)
        self._motor += self._rng.normal(0, 0.5)
        is_weak = self._goal > self._change_at and self._motor > _HOT
        if not has_ended and is_weak and self._rng.random() < _FAILS:
            return -1.0
        return reward if has_ended or self._since >= MAX_STEPS else None

    def _begin(self) -> None:
        self._observation, self._motor = self._world.reset(), self._rng.uniform(20, 80)
        self._goal += 1
        self._command = np.zeros(2)
        self._tell(GoalStatus.STATUS_EXECUTING)

    def _end(self, reward: float) -> None:
        self._tell(_STATUSES[reward])
        print(json.dumps({'reward': reward}), flush=True)

    def _tell(self, status: int) -> None:
        self._since = 0
        self._status = GoalStatus(status=status)
        self._status.goal_info.goal_id.uuid[:4] = np.array(
            list(self._goal.to_bytes(4, 'big')), np.uint8
        )
        self._publishers[GoalStatusArray].publish(GoalStatusArray(status_list=[self._status]))

    def _publish(self) -> None:
        header = Header(stamp=self._clock.now().to_msg(), frame_id='base')
        odometry, imu = Odometry(header=header), Imu(header=header)
        position = odometry.pose.pose.position
        position.x, position.y = map(float, self._observation[:2])
        imu.linear_acceleration.x = self._rng.normal()
        for message in (
            scan_of(header, self._observation[2:]),
            Temperature(header=header, temperature=self._motor),
            imu,
            odometry,
        ):
            self._publishers[type(message)].publish(message)


def command_of(state: dict[str, float]) -> np.ndarray:
    """Return the velocity by which to drive, from what there is of x, y and the rays."""
    at = [state.get(name, math.nan) for name in ('x', 'y')]
    way = np.array(GOAL) - np.where(np.isfinite(at), at, 5.0)
    velocity = SPEED * way / max(float(np.linalg.norm(way)), 1e-6)
    rays = np.array([state.get(f'scan[{i}]', math.nan) for i in range(NUM_RAYS)])
    near = np.nan_to_num(np.maximum(0, _CLEARANCE - rays))
    return velocity - _REPULSION * (near @ np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]))


def robot(node, executor, stopping: list, arguments: list[str]) -> None:
    """Live step by step until all goals have ended."""
    num_goals, change_at, seed = map(int, arguments[:3])
    period = STEP_SECONDS / float(arguments[3])
    it = Robot(node, num_goals, change_at, seed)
    while not stopping and not it.is_heard:
        executor.spin_once(0.1)
    due = time.monotonic()
    while not stopping and it.step():
        due = max(due + period, time.monotonic())
        while (left := due - time.monotonic()) > 0:
            executor.spin_once(left)


def lidar(node, executor, stopping: list, arguments: list[str]) -> None:
    """See another robot's surroundings while somebody listens, and print what was published."""
    rng, period = np.random.default_rng(int(arguments[0])), STEP_SECONDS / float(arguments[1])
    world = LidarWorld(rng, num_rays=NUM_OTHER_RAYS)
    observation, size, count = world.reset(), 0, 0
    publisher = node.create_publisher(LaserScan, '/other/scan', qos_profile_sensor_data)
    due = told_at = time.monotonic()
    while not stopping:
        if publisher.get_subscription_count():
            observation, _, has_ended = world.step()
            observation = world.reset() if has_ended else observation
            stamp = node.get_clock().now().to_msg()
            scan = scan_of(Header(stamp=stamp, frame_id='other'), observation[2:])
            publisher.publish(scan)
            count, size = count + 1, len(serialize_message(scan))
        if time.monotonic() > told_at + 0.5:
            told_at = time.monotonic()
            print(json.dumps({'messages': count, 'bytes': count * size}), flush=True)
        due = max(due + period, time.monotonic())
        executor.spin_once(max(0.0, due - time.monotonic()))


def control(node, executor, stopping: list, arguments: list[str]) -> None:
    """Command whatever `selected_state` says."""
    publisher = node.create_publisher(Twist, '/cmd_vel', 10)

    def act(message: JointState) -> None:
        command = Twist()
        velocity = command_of(dict(zip(message.name, message.position, strict=True)))
        command.linear.x, command.linear.y = map(float, velocity)
        publisher.publish(command)

    node.create_subscription(JointState, 'selected_state', act, STREAM_QOS)
    while not stopping:
        executor.spin_once(0.1)


ROLES = {'robot': robot, 'lidar': lidar, 'control': control}


def main() -> None:
    """Run one of them."""
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    role, *arguments = rclpy.utilities.remove_ros_args(sys.argv)[1:]
    node = rclpy.create_node(f'saving_{role}')
    executor = make_executor()
    executor.add_node(node)
    ROLES[role](node, executor, stopping, arguments)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
