# SPDX-License-Identifier: Apache-2.0

"""`selected_state` of a sampler: the selected channels for controllers, at once."""

from __future__ import annotations

import json
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from cmifs_ros.collect.episodes.filter import LAYOUTS, layout_of
from cmifs_ros.collect.robot_file.model import RobotFile
from cmifs_ros.collect.sampling.message_reader import event_time
from cmifs_ros.collect.sampling.newest_values import NewestValues
from cmifs_ros.core.words import first, listed

from . import conversions, diagnostics
from .parameters import Spec
from .qos import LATCHED_QOS, STREAM_QOS

#: Seconds for which the log does not say again of a sensor that comes and goes that it is gone.
_SAID_FOR = 10.0
#: Of the relay of the selector, and of the sampler.
SELECTED_STATE_PARAMETERS = (
    Spec('layout', 'selected',
         'What selected_state holds: the selected channels, or all in fixed places, nan where not '
         'selected.', choices=LAYOUTS),
    Spec('pass_through_until_selected', True,
         'Publish all channels on selected_state before the first selection, in place of none.'),
)  # fmt: skip
PARAMETERS = (
    *SELECTED_STATE_PARAMETERS,
    Spec('stop_on_missing_channel', False,
         'While a selected channel is gone, publish no selected_state, in place of nan for it.'),
)  # fmt: skip


class SelectedState:
    """Publish the newest values of the selected channels at each step, and say which are gone.

    Parameters
    ----------
    node : rclpy.node.Node
    robot : RobotFile
    settings : dict
        The node's parameters by name, which follows their changes.
    is_simulated : bool
        The time is that of `set_clock`.

    """

    def __init__(self, node: Node, robot: RobotFile, settings: dict, is_simulated: bool):
        self._node, self._robot, self._settings = node, robot, settings
        self._newest = NewestValues(robot)
        self._number: int | None = None  # of the selection in use
        self._selected: set[str] | None = None
        self._told_gone: set[str] = set()  # Sensors that the log says are gone.
        self._silent_until: dict[str, float] = {}  # By sensor, until when it does not say so again.
        self._num_sent = 0
        self._simulated: int | None = None
        self._is_simulated = is_simulated
        self._message = JointState()  # One for all: a new one takes as long to make.
        self._publisher = node.create_publisher(JointState, 'selected_state', STREAM_QOS)
        node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)
        self._period = int(conversions.NANOSECONDS / robot.rate) if robot.rate else None
        self._last_tick: int | None = None
        self._timer = None
        if self._period and not is_simulated:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = node.create_timer(self._period / 1e9, self._on_timer, clock=clock)
        self.apply()

    def apply(self) -> None:
        """Take over the parameters."""
        names = self._robot.channel_names
        layout = layout_of(self._settings['layout'], names, self._selected)
        self._newest.select(names if self._selected is None else self._selected, layout)
        self._message.name = self._newest.names
        self._message.header.frame_id = '' if self._number is None else str(self._number)

    def take(self, topic: str, message, received: int) -> None:
        """Take a message; publish if it is a step.

        Parameters
        ----------
        topic : str
        message : object
        received : int
            In nanoseconds; the stamp of what has none.

        """
        self._newest.take(topic, message, self._now())
        if topic == self._robot.step_topic:
            self._publish(event_time(message) or received)

    def set_clock(self, simulated: int) -> None:
        """Take the simulated time in nanoseconds."""
        self._simulated = simulated
        if self._period is not None and simulated // self._period != self._last_tick:
            self._last_tick = simulated // self._period
            self._publish(self._last_tick * self._period)

    def status(self) -> DiagnosticStatus:
        """Return what is to be said of it once a second."""
        name = f'{self._node.get_fully_qualified_name().lstrip("/")}: selected_state'
        level, message = diagnostics.OK, 'nothing before the first selection'
        if self._selected is not None:
            message = listed(self._newest.names)
        elif self._settings['pass_through_until_selected']:
            message = 'all channels, before the first selection'
        if self._newest.missing:
            level, message = diagnostics.WARN, self._lack(self._newest.missing)
        values = {
            'messages': self._num_sent,
            'number': '' if self._number is None else self._number,
            'subscribers': self._publisher.get_subscription_count(),
        }
        return diagnostics.status(name, level, message, values)

    def _now(self) -> int:
        return (self._simulated or 0) if self._is_simulated else time.monotonic_ns()

    def _on_timer(self) -> None:
        # Steps are at whole multiples of the period, live and from a bag; clocks drift apart.
        now = self._node.get_clock().now().nanoseconds
        tick = round(now / self._period)
        self._timer.timer_period_ns = max(1, (tick + 1) * self._period - now)
        self._timer.reset()
        self._publish(tick * self._period)

    def _publish(self, stamp: int) -> None:
        if self._selected is None and not self._settings['pass_through_until_selected']:
            return
        values = self._newest.state(self._now())
        if self._selected is not None:
            self._say_gone()
        if self._newest.missing and self._settings['stop_on_missing_channel']:
            return
        self._num_sent += 1
        if self._publisher.get_subscription_count():
            out = self._message
            out.header.stamp = conversions.stamp_from_nanoseconds(stamp)
            out.position = values
            self._publisher.publish(out)

    def _say_gone(self) -> None:
        now, gone, told = time.monotonic(), self._newest.missing, self._told_gone
        due = {n for n in gone.keys() - told if now > self._silent_until.get(n, 0.0)}
        fresh = {name: why for name, why in gone.items() if name in due}
        self._told_gone = (told & gone.keys()) | due
        self._silent_until |= dict.fromkeys(due, now + _SAID_FOR)
        if fresh:
            self._node.get_logger().warning(self._lack(fresh))
        elif told and not gone:
            self._node.get_logger().info('selected_state has all selected channels again')

    def _lack(self, gone: dict[str, str]) -> str:
        shown = first([f'{name}: {why}' for name, why in gone.items()])
        if self._settings['stop_on_missing_channel']:
            return f'selected_state stops, as it lacks {shown}'
        return f'selected_state has nan for {shown}'

    def _on_selection(self, message: String) -> None:
        try:
            found = json.loads(message.data)
            number, names = found['number'], list(found['names'])
            unknown = [name for name in names if name not in self._robot.channel_names]
        except (ValueError, TypeError, KeyError) as error:
            self._node.get_logger().warning(f'a selection cannot be read: {error}')
            return
        if unknown:
            self._node.get_logger().warning(
                f'a selection of {listed(names)} is not used: the robot file has no channel '
                f'{unknown[0]!r}; call ~/clear_episodes of the selector if it has others now'
            )
        else:
            is_news = set(names) != self._selected
            self._number, self._selected = number, set(names)
            self.apply()
            if is_news:
                self._node.get_logger().info(f'selected_state is {listed(self._newest.names)} now')
