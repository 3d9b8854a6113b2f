# SPDX-License-Identifier: Apache-2.0

"""A robot that drives from goal to goal in the lidar world, and its sensor messages.

Its time is counted in ticks of 10 ms.
"""

from __future__ import annotations

import numpy as np
from action_msgs.msg import GoalStatus, GoalStatusArray
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_action_status_default
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Imu, LaserScan
from std_msgs.msg import Float32, Header

from cmifs_ros.ros import conversions
from studies.tasks.lidar_world import MAX_STEPS, RANGE_MAX, STEP_SECONDS, LidarWorld

#: In ns.
TICK = 10_000_000
_MOVE, STEP = 5, round(STEP_SECONDS * 1e9 / TICK)
#: Messages without a stamp are sent between two steps, so that small delays do not matter.
BETWEEN = STEP // 2
#: Steps that the robot rests between two goals.
_REST = 3
STATUS = '/go_to/_action/status'
_RELIABLE = QoSProfile(depth=1000)
_SENSOR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Type and quality of service by topic.
TOPICS = {
    '/clock': (Clock, _RELIABLE),
    '/odom': (Odometry, _RELIABLE),
    '/scan': (LaserScan, _SENSOR),
    '/other/scan': (LaserScan, _SENSOR),
    '/imu': (Imu, _SENSOR),
    '/battery_state': (BatteryState, _RELIABLE),
    '/temperature': (Float32, _RELIABLE),
    '/radio': (Float32, _RELIABLE),
    STATUS: (GoalStatusArray, qos_profile_action_status_default),
}


class Drive:
    """Goals of an action, one after the other; start and obstacles are drawn anew for each.

    Attributes
    ----------
    goals : list of int
        Status of each goal so far, of action_msgs/GoalStatus.
    observation : numpy.ndarray, shape (14,)
        x, y and the rays, in m.
    velocity : numpy.ndarray, shape (2,)

    """

    def __init__(self, rng: np.random.Generator):
        self._world = LidarWorld(rng, _MOVE * TICK / 1e9)
        self.goals: list[int] = []
        self.observation = self._world.reset()
        self.velocity = np.zeros(2)
        self._reward: float | None = None  # The reward for the goal, once it has ended.
        self._since = 0

    @property
    def num_ended(self) -> int:
        """Number of finished goals."""
        return sum(status != GoalStatus.STATUS_EXECUTING for status in self.goals)

    def go_on(self, tick: int) -> bool:
        """Advance by a tick; return whether the status of a goal changes."""
        is_running = self.goals[-1:] == [GoalStatus.STATUS_EXECUTING]
        if is_running and self._reward is None:
            if tick % STEP == 0:
                self.velocity = self._world.steer()
            if tick % _MOVE == 0:
                self.observation, reward, has_ended = self._world.move(self.velocity)
                self._reward = reward if has_ended else None
        if tick % STEP != BETWEEN:
            return False
        self._since += 1
        if is_running and self._reward is not None:
            has_arrived = self._reward > 0
            self._change(GoalStatus.STATUS_SUCCEEDED if has_arrived else GoalStatus.STATUS_ABORTED)
        elif is_running and self._since >= MAX_STEPS:
            self._change(GoalStatus.STATUS_CANCELED)
        elif not is_running and self._since == _REST:
            self.observation = self._world.reset()
            self.goals.append(GoalStatus.STATUS_UNKNOWN)
            self._change(GoalStatus.STATUS_EXECUTING)
        else:
            return False
        return True

    def _change(self, status: int) -> None:
        self.goals[-1] = status
        self.velocity = np.zeros(2)
        self._reward = None
        self._since = 0


class Sensors:
    """The messages at each tick, including those of another robot's lidar.

    Parameters
    ----------
    seed : int

    """

    def __init__(self, seed: int):
        own, other, rest = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(3))
        self.drive, self._other, self._rng = Drive(own), Drive(other), rest
        self._battery, self._temperature = 1.0, 25.0

    def messages(self, tick: int) -> dict[str, object]:
        """Advance by a tick; return messages by topic, in the order of sending."""
        changes = self.drive.go_on(tick)
        self._other.go_on(tick)
        header = Header(stamp=conversions.stamp_from_nanoseconds(tick * TICK), frame_id='base')
        found: dict[str, object] = {'/clock': Clock(clock=header.stamp)}
        if tick % 2 == 0:
            imu = found['/imu'] = Imu(header=header)
            imu.linear_acceleration.x = self._rng.normal()
        if tick % 5 == 0:
            odometry = found['/odom'] = Odometry(header=header)
            position, twist = odometry.pose.pose.position, odometry.twist.twist.linear
            position.x, position.y = map(float, self.drive.observation[:2])
            twist.x, twist.y = map(float, self.drive.velocity)
        if tick % 10 == 0:
            found['/scan'] = scan_of(header, self.drive.observation[2:])
            found['/other/scan'] = scan_of(header, self._other.observation[2:])
        if tick % 100 == 0:
            self._battery = self._battery - 0.001 if self._battery > 0.1 else 1.0
            found['/battery_state'] = BatteryState(header=header, percentage=self._battery)
        if tick % 100 == BETWEEN:
            self._temperature += self._rng.normal(0, 0.2)
            found['/temperature'] = Float32(data=self._temperature)
        if tick % STEP == BETWEEN:
            found['/radio'] = Float32(data=self._rng.normal(-60, 5))
        if changes:
            found[STATUS] = self._status(header)
        return found

    def _status(self, header: Header) -> GoalStatusArray:
        """Return the statuses of the newest goals, as an action server keeps them for a while."""
        array = GoalStatusArray()
        for number in range(max(0, len(self.drive.goals) - 3), len(self.drive.goals)):
            entry = GoalStatus(status=self.drive.goals[number])
            entry.goal_info.goal_id.uuid[:4] = np.array(list(number.to_bytes(4, 'big')), np.uint8)
            entry.goal_info.stamp = header.stamp
            array.status_list.append(entry)
        return array


def scan_of(header: Header, ranges: np.ndarray) -> LaserScan:
    """Return a scan; a ray without an obstacle is inf, as in drivers."""
    seen = np.where(ranges < RANGE_MAX, ranges, np.inf)
    return LaserScan(header=header, angle_max=2 * np.pi, range_max=RANGE_MAX, ranges=seen.tolist())
