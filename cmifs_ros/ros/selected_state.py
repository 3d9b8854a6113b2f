# SPDX-License-Identifier: Apache-2.0

"""The sampler's `selected_state`: the selected channels for controllers, without delay."""

from __future__ import annotations

import json
import time
from collections import deque

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import String

from cmifs_ros.collect.episodes.filter import layout_of
from cmifs_ros.collect.json_values import count_of, names_of
from cmifs_ros.collect.robot_file.model import RobotFile
from cmifs_ros.collect.sampling.message_reader import event_time
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.newest_values import NewestValues
from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.words import first, listed

from . import conversions, diagnostics, selected_state_publisher
from .parameters import Spec
from .qos import LATCHED_QOS
from .selected_state_publisher import SelectedStatePublisher

#: Seconds before the log repeats that an intermittent sensor is missing.
_REPEATED_AFTER = 10.0
#: Longest time in seconds that a new selection waits for channels without a valid message.
_MAX_DELAY = 1.0
#: The step's topic counts as silent if others go on for more than this many seconds without it,
_STEP_SILENCE = 1.0
#: and for more than twice the longest of its last pauses, of which this many are kept.
_NUM_PAUSES = 20
PARAMETERS = (
    *selected_state_publisher.PARAMETERS,
    Spec('stop_on_missing_channel', False,
         'While a selected channel is missing, publish no selected_state instead of nan for it.'),
)  # fmt: skip


class SelectedState:
    """Publish the newest values of the selected channels at each step; report missing ones.

    Parameters
    ----------
    node : rclpy.node.Node
    robot : RobotFile
    settings : dict
        The node's parameters by name, kept up to date.
    is_simulated : bool
        Time comes from `set_clock`.

    """

    def __init__(self, node: Node, robot: RobotFile, settings: dict, is_simulated: bool):
        self._node, self._robot, self._settings = node, robot, settings
        self._newest = NewestValues(robot)
        self._number: int | None = None  # of the selection in use
        self._selected: set[str] | None = None
        self._next: tuple[int, set[str], float] | None = None  # And when it is due at the latest.
        self._logged_missing: set[str] = set()  # Sensors last logged as missing.
        self._silent_until: dict[str, float] = {}  # By sensor, when to log again.
        self._is_waiting = True
        self._heard_at = time.monotonic()
        self._pause = 0.0  # Of the step's topic, while others went on.
        self._pauses: deque[float] = deque(maxlen=_NUM_PAUSES)
        self._is_stopped = False  # The step's topic is silent.
        self._num_sent = 0
        self._simulated: int | None = None
        self._is_simulated = is_simulated
        self._publisher = SelectedStatePublisher(node, settings)
        node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)
        self._period = int(SECOND / robot.rate) if robot.rate else None
        self._last_tick: int | None = None
        self._timer = None
        if self._period and not is_simulated:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = node.create_timer(self._period / 1e9, self._on_timer, clock=clock)
        self.apply()

    def apply(self) -> None:
        """Apply changed parameters."""
        names = self._robot.channel_names
        layout = layout_of(self._settings['layout'], names, self._selected)
        self._newest.select(names if self._selected is None else self._selected, layout)
        self._publisher.use(self._number)

    def take(self, topic: str, message, received: int) -> None:
        """Take a message; publish if it is a step.

        Parameters
        ----------
        topic : str
        message : object
        received : int
            Receive time in nanoseconds, used for a message without a stamp.

        """
        self._newest.take(topic, message, self._now())
        self._watch_step(topic)
        if topic == self._robot.step_topic:
            self._publish(event_time(message) or received)

    def set_clock(self, simulated: int) -> None:
        """Take the simulated time in nanoseconds."""
        self._simulated = simulated
        if self._period is not None and simulated // self._period != self._last_tick:
            self._last_tick = simulated // self._period
            self._publish(self._last_tick * self._period)

    def status(self) -> DiagnosticStatus:
        """Return its status, once a second."""
        name = f'{diagnostics.name_of(self._node)}: selected_state'
        level, message = diagnostics.OK, 'nothing before the first selection'
        if self._selected is not None:
            message = self._selected_in_words()
        elif self._settings['pass_through_until_selected']:
            message = 'all channels, before the first selection'
        if self._is_stopped:
            level, message = diagnostics.WARN, self._stopped_in_words()
        elif self._newest.missing:
            level, message = diagnostics.WARN, self._in_words(self._newest.missing)
        values = {
            'messages': self._num_sent,
            'number': '' if self._number is None else self._number,
            'subscribers': self._publisher.num_subscribers,
        }
        return diagnostics.status(name, level, message, values)

    def _now(self) -> int:
        return (self._simulated or 0) if self._is_simulated else time.monotonic_ns()

    def _watch_step(self, topic: str) -> None:
        """Log that the step's topic is silent, or heard again, as a message of any topic shows."""
        step, now = self._robot.step_topic, time.monotonic()
        # If the node lags, messages of other topics may be taken first.
        self._pause += min(now - self._heard_at, _STEP_SILENCE / 2)
        self._heard_at = now
        if topic == step:
            self._pauses.append(self._pause)
            self._pause = 0.0
            if self._is_stopped:
                self._is_stopped = False
                self._node.get_logger().info(f'{step} is heard again')
        elif step is not None and not self._is_stopped:
            usual = max(self._pauses, default=0.0)
            self._is_stopped = self._pause > max(_STEP_SILENCE, 2 * usual)
            if self._is_stopped:
                self._node.get_logger().warning(self._stopped_in_words())

    def _stopped_in_words(self) -> str:
        return f'no step: {self._robot.step_topic} is silent'

    def _on_timer(self) -> None:
        # Steps are at multiples of the period, live and from a bag; the two clocks drift apart.
        now = self._node.get_clock().now().nanoseconds
        tick = round(now / self._period)
        self._timer.timer_period_ns = max(1, (tick + 1) * self._period - now)
        self._timer.reset()
        self._publish(tick * self._period)

    def _publish(self, stamp: int) -> None:
        self._take_over()
        if self._selected is None and not self._settings['pass_through_until_selected']:
            return
        values = self._newest.state(self._now())
        self._is_waiting = values is None
        if values is None:
            return
        if self._selected is not None:
            self._log_missing()
        if self._newest.missing and self._settings['stop_on_missing_channel']:
            return
        self._num_sent += 1
        self._publisher.publish(
            conversions.stamp_from_nanoseconds(stamp), self._newest.names, values
        )

    def _log_missing(self) -> None:
        now, missing, logged = time.monotonic(), self._newest.missing, self._logged_missing
        due = {n for n in missing.keys() - logged if now > self._silent_until.get(n, 0.0)}
        fresh = {name: why for name, why in missing.items() if name in due}
        self._logged_missing = (logged & missing.keys()) | due
        self._silent_until |= dict.fromkeys(due, now + _REPEATED_AFTER)
        if fresh:
            self._node.get_logger().warning(self._in_words(fresh))
        elif logged and not missing:
            self._node.get_logger().info('selected_state has all selected channels again')

    def _in_words(self, missing: dict[str, str]) -> str:
        shown = first([f'{name}: {why}' for name, why in missing.items()])
        if self._is_waiting:
            return f'no selected_state yet; missing: {shown}'
        if self._settings['stop_on_missing_channel']:
            return f'selected_state stops; missing: {shown}'
        return f'selected_state has nan for {shown}'

    def _on_selection(self, message: String) -> None:
        try:
            found = json.loads(message.data)
            number, names = count_of(found['number']), names_of(found['names'], MAX_CHANNELS)
            unknown = [name for name in names if name not in self._robot.channel_names]
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            self._node.get_logger().warning(f'a selection cannot be read: {error!r}')
            return
        if unknown:
            self._node.get_logger().warning(
                f'the selection of {listed(names)} is ignored: the robot file has no channel '
                f'{unknown[0]!r}; if the file has changed, call ~/clear_episodes of the selector'
            )
        else:
            self._next = number, set(names), time.monotonic() + _MAX_DELAY
            self._take_over()

    def _take_over(self) -> None:
        """Use the newest selection, once topics that were switched off are heard again."""
        if self._next is None:
            return
        number, selected, due = self._next
        if time.monotonic() < due and not self._newest.has(selected, self._now()):
            return
        is_news = selected != self._selected
        self._number, self._selected, self._next = number, selected, None
        self.apply()
        if is_news:
            self._node.get_logger().info(f'selected_state is now {self._selected_in_words()}')

    def _selected_in_words(self) -> str:
        names = [name for name in self._robot.channel_names if name in (self._selected or ())]
        return listed(names) or 'empty: nothing is selected'
