# SPDX-License-Identifier: Apache-2.0

"""The sampler node: publishes `state`, `action` and `reward` from a robot's own topics."""

from __future__ import annotations

import math
import sys
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockTime
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cmifs_ros.collect.robot_file import load_robot_file
from cmifs_ros.collect.robot_file.model import STATUS
from cmifs_ros.collect.sampling.message_reader import event_time
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.sampler import Sampler
from cmifs_ros.collect.sampling.step import Step
from cmifs_ros.collect.simulated_time import CLOCK, SimulatedTime
from cmifs_ros.core.targets import TARGETS
from cmifs_ros.core.words import listed

from . import conversions, diagnostics, selected_state
from .following_subscription import FollowingSubscription
from .parameters import Spec, declare
from .qos import STREAM_QOS
from .run_node import run_node
from .sampler_status import SamplerStatus
from .selected_state import SelectedState
from .topic_saving import TopicSaving
from .topic_traffic import TopicTraffic

PARAMETERS = (
    Spec('robot_file', '', 'Path of the robot file.', read_only=True),
    Spec(
        'max_lateness',
        5.0,
        'Longest time to wait for late messages of a topic, in seconds.',
        read_only=True,
    ),
    *selected_state.PARAMETERS,
)
#: Messages of a topic that may wait for the node, and of one of images or clouds.
_DEPTH, _LARGE_DEPTH = 1000, 10
#: Seconds without any message after which waiting steps are made.
_QUIET = 2.0


def _check(values: dict) -> None:
    if not 0 <= values['max_lateness'] < math.inf:
        raise ValueError(f'max_lateness is {values["max_lateness"]}; expected seconds, 0 or more')


class SamplerNode(Node):
    """Subscribe to the topics of a robot file, each as soon as it is published."""

    def __init__(self):
        super().__init__('sampler')
        self._selected_state: SelectedState | None = None
        settings = declare(self, PARAMETERS, _check, self._apply_parameters)
        if not settings['robot_file']:
            raise ValueError(
                'robot_file is empty; expected the path of a robot file, as in '
                '--ros-args -p robot_file:=my_robot.yaml'
            )
        self._robot = load_robot_file(settings['robot_file'])
        self._names = self._robot.channel_names
        discount = vars(self._robot.discount) if self._robot.discount else {}
        self._asked = {key: value for key, value in discount.items() if value is not None}
        if self._robot.target:
            self._asked['target'] = float(TARGETS.index(self._robot.target))
        self._sampler = Sampler(self._robot, settings['max_lateness'])
        is_simulated = self.get_parameter('use_sim_time').value
        # Before `state`: the selector relays states only of nodes without `selected_state`.
        self._selected_state = SelectedState(self, self._robot, settings, is_simulated)
        self._simulated = SimulatedTime() if is_simulated else None
        self._traffic = TopicTraffic(self, self._robot, self._simulated)
        self._saving: TopicSaving | None = None
        if self._robot.saving:
            self._saving = TopicSaving(self, self._sampler.saving, self._traffic.meter)
        self._state_publisher = self.create_publisher(JointState, 'state', STREAM_QOS)
        self._action_publisher = None
        if self._robot.action_names:
            self._action_publisher = self.create_publisher(JointState, 'action', STREAM_QOS)
        self._reward_publisher = self.create_publisher(JointState, 'reward', STREAM_QOS)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        max_ages = dict.fromkeys(self._robot.topics, 0.0)
        for source in self._robot.sources:
            max_ages[source.path.topic] = max(max_ages[source.path.topic], source.max_age)
        if self._robot.action:
            max_ages[self._robot.action + STATUS] = math.inf  # Published only when a goal changes.
        self._status = SamplerStatus(diagnostics.name_of(self), self._sampler, max_ages)
        self._subscriptions_by_topic: dict[str, FollowingSubscription] = {}
        self._problems: dict[str, str] = {}
        self._refused: set[str] = set()
        if is_simulated:
            # rclpy's own clock knows only the newest time: to a node that lags, all queued messages
            # would seem to arrive at once. Here /clock is queued with them, as in a bag.
            FollowingSubscription(self, ClockTime, CLOCK, self._on_clock)
        # Steady time: a paused simulation must not stop them.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.2, self._discover, clock=clock)
        self.create_timer(1.0, self._report, clock=clock)
        self._discover()

    def _apply_parameters(self, changed: dict) -> None:
        self._selected_state.apply()

    def _discover(self) -> None:
        """Subscribe to the topics whose type is known by now; subscribe again if it has changed.

        Topics that are switched off are unsubscribed.
        """
        off = self._sampler.saving.off
        if self._saving is not None:
            self._saving.tell()
        types = self._robot.types or {}
        for topic in self._robot.topics:
            subscription = self._subscriptions_by_topic.get(topic)
            if topic in off:
                if subscription is not None:
                    subscription.destroy()
                    del self._subscriptions_by_topic[topic]
                self._problems.pop(topic, None)
            elif subscription is None:
                self._subscribe(topic, types.get(topic))
            elif subscription.clashes and not subscription.publishers and topic not in types:
                # The next call subscribes again; until then the old type is kept.
                subscription.destroy()
                del self._subscriptions_by_topic[topic]

    def _subscribe(self, topic: str, name: str | None) -> None:
        """Subscribe to a topic with this type, or with the type of its publishers."""
        publishers = self.get_publishers_info_by_topic(self.resolve_topic_name(topic))
        name = name or next((p.topic_type for p in publishers if p.topic_type), None)
        if name is None:
            self._problems[topic] = 'nobody publishes it'
            return
        try:
            message_type = conversions.message_type(name)
        except (ValueError, ImportError, AttributeError) as error:
            self._problems[topic] = f'its type {name} is not installed here: {error}'
            if topic not in self._refused:
                self._refused.add(topic)
                self.get_logger().error(f'{topic}: {self._problems[topic]}')
            return
        try:
            self._subscriptions_by_topic[topic] = FollowingSubscription(
                self, message_type, topic, partial(self._take, topic),
                depth=_LARGE_DEPTH if topic in self._robot.large_topics else _DEPTH,
            )  # fmt: skip
        except RuntimeError as error:  # From the middleware, which may still hold another type.
            self._problems[topic] = f'no subscription to {name}: {error}'
            return
        self._problems.pop(topic, None)

    def _on_clock(self, message: ClockTime) -> None:
        self._simulated.take(message)
        self._selected_state.set_clock(self._simulated.now)
        self._publish(self._sampler.set_clock(self._simulated.now))

    def _take(self, topic: str, message) -> None:
        stamp, now = event_time(message), self.get_clock().now().nanoseconds
        self._status.heard(topic, math.inf if stamp is None else (now - stamp) / SECOND)
        try:
            # The source timestamp is unknown: the EventsExecutor of rclpy 7.1.6 fails on callbacks
            # that ask for the message's info.
            simulated = self._simulated.now if self._simulated is not None else 0
            received = simulated or now
            self._selected_state.take(topic, message, received)
            self._traffic.take(topic, message)
            steps = self._sampler.add(topic, message, received)
        except Exception as error:  # No message must end the node.
            self._sampler.note_wrong(topic, f'{type(error).__name__}: {error}')
            return
        self._publish(steps)

    def _publish(self, steps: list[Step]) -> None:
        for step in steps:
            header = Header(stamp=conversions.stamp_from_nanoseconds(step.stamp))
            self._state_publisher.publish(
                conversions.named_values_to_msg(header, self._names, step.state)
            )
            if self._action_publisher is not None:
                self._action_publisher.publish(
                    conversions.named_values_to_msg(header, self._robot.action_names, step.action)
                )
            fields = step.sample._asdict() | self._asked
            self._reward_publisher.publish(
                conversions.named_values_to_msg(header, fields, fields.values())
            )

    def _report(self) -> None:
        if self._status.silence() > _QUIET:  # If the robot is idle, its last episode is due.
            self._publish(self._sampler.flush())
        problems = dict(self._problems)
        for topic, subscription in self._subscriptions_by_topic.items():
            if subscription.clashes and not subscription.publishers:
                kinds = sorted(subscription.clashes)
                problem = self._robot.type_problem(topic, kinds)
                problems[topic] = problem or f'it is now published as {listed(kinds)}'
                if problem and topic not in self._refused:
                    self._refused.add(topic)
                    self.get_logger().error(problem)
        for line in self._status.news():
            self.get_logger().warning(line)
        self._traffic.report(self._sampler.saving.off, self._sampler.ends.problem())
        statuses = [*self._status.statuses(problems), self._selected_state.status()]
        if self._saving is not None:
            statuses.append(self._saving.status())
        self._diagnostics_publisher.publish(
            diagnostics.diagnostic_array(self.get_clock().now().to_msg(), *statuses)
        )


if __name__ == '__main__':
    sys.exit(run_node('sampler_node', 'SamplerNode'))
