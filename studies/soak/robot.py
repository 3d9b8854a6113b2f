# SPDX-License-Identifier: Apache-2.0

"""A robot that publishes numbered transitions and keeps the replies."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import ListParameters
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32MultiArray
from std_srvs.srv import Trigger

from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.ros import conversions
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools.program import CommandError
from studies.nodes.process import Process

from .messages import FIELDS, LENGTH, NAMES, NUM_CHANNELS

QOS = QoSProfile(depth=20_000)


class Robot:
    """Publish numbered transitions, and subscribe to the selector.

    The first channel and the reward of a transition are its number, so that the origin of each
    collected episode is known.

    Parameters
    ----------
    listens : bool
        Whether to subscribe to selected states.

    """

    def __init__(self, listens: bool = True):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('soak', context=self.context)
        self.executor = make_executor(self.context)
        self.executor.add_node(self.node)
        self._outputs: dict[str, list[Publisher]] = {}
        self.states, self.rewards = self.outputs('')
        self.calls = self.node.create_client(Trigger, 'select_features', qos_profile=QOS)
        self.parameters = self.node.create_client(ListParameters, 'selector/list_parameters')
        self.clear = self.node.create_client(Trigger, 'selector/clear_episodes')
        self.latencies: list[float] = []
        self.is_selecting = False
        self.num_selections = 0
        self.newest_relayed = 0
        self.counts = [0, 0]
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.levels: dict[str, tuple[bytes, str]] = {}
        self.number = 0
        self._rng = np.random.default_rng(0)
        self._sent_at: dict[int, int] = {}
        for kind, topic, callback, qos in (
            (JointState, 'selected_state', self._on_selected, QOS),
            (JointState, '/relay/selected_state', self._on_selected, QOS),
            (DiagnosticArray, '/diagnostics', self._on_diagnostics, 10),
            (Int32MultiArray, 'counts', self._on_counts, 1),
        )[0 if listens else 2 :]:
            self.node.create_subscription(kind, topic, callback, qos)

    def outputs(self, namespace: str) -> list[Publisher]:
        """Return the publishers of states and rewards in a namespace."""
        if namespace not in self._outputs:
            self._outputs[namespace] = [
                self.node.create_publisher(
                    JointState, f'{namespace}/{topic}' if namespace else topic, QOS
                )
                for topic in ('state', 'reward')
            ]
        return self._outputs[namespace]

    def close(self) -> None:
        """Destroy the node."""
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_selected(self, msg: JointState) -> None:
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self.newest_relayed = stamp - 1
        sent_at = self._sent_at.pop(stamp, None)
        if sent_at is not None:
            self.latencies.append((time.monotonic_ns() - sent_at) / 1e6)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            self.diagnostics[status.name] = {pair.key: pair.value for pair in status.values}
            self.levels[status.name] = (status.level, status.message)

    def _on_counts(self, msg: Int32MultiArray) -> None:
        self.counts = list(msg.data)

    def until(self, condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
        """Spin until a condition holds; raise if that takes too long."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                raise CommandError(f'waited in vain until {what}; {self.levels} {self.diagnostics}')
            self.executor.spin_once(0.05)

    def rest(self, seconds: float) -> None:
        """Spin for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(left)

    def settled_transitions(self) -> int:
        """Return the number of transitions of the selector once it has processed all."""
        before = None
        while True:
            self.diagnostics.clear()
            self.until(lambda: self.input, 'diagnostics came')
            now = int(self.input['transitions'])
            if now == before:
                return now
            before = now

    def wait_for(self, output: str) -> None:
        """Wait until the node that publishes a topic is running and subscribed."""
        namespace = output.rpartition('/')[0]
        states, _ = self.outputs(namespace)
        self.until(
            lambda: states.get_subscription_count() and self.node.count_publishers(output),
            f'the node that publishes {output} is there',
        )
        if output == 'selected_state' and self.node.count_publishers('scores'):
            self.until(
                lambda: self.input and self.calls.service_is_ready(), 'the selector is there'
            )
            self.until(self.rewards.get_subscription_count, 'the selector listens')
        self.rest(1.0)

    @property
    def input(self) -> dict[str, str]:
        """The selector's status of its input."""
        return self.diagnostics.get('selector: input', {})

    @property
    def selection(self) -> dict[str, str]:
        """The selector's status of its selection."""
        return self.diagnostics.get('selector: selection', {})

    def transition(self) -> tuple[JointState, JointState]:
        """Return the messages of the next transition."""
        number, self.number = self.number, self.number + 1
        position = self._rng.normal(size=NUM_CHANNELS)
        position[0] = number
        state = JointState(name=NAMES, position=position.tolist())
        state.header.stamp = conversions.stamp_from_nanoseconds(number + 1)
        episode, step = divmod(number, LENGTH)
        ends = step == LENGTH - 1
        fields = [number, 0, ends, episode, step]
        reward = JointState(name=FIELDS, position=[float(f) for f in fields])
        reward.header.stamp = state.header.stamp
        return state, reward

    def run(self, rate: float, count: int, to: str = '') -> None:
        """Publish transitions at a rate, for the selector or in another namespace."""
        states, rewards = self.outputs(to)
        number = self.number
        begin = time.monotonic()
        for sent in range(count):
            while (left := begin + sent / rate - time.monotonic()) > 0:
                self.executor.spin_once(left)
            state, reward = self.transition()
            self._sent_at[self.number] = time.monotonic_ns()
            states.publish(state)
            rewards.publish(reward)
        if to:  # The selector saw none of these.
            self.number = number

    def select_back_to_back(self) -> None:
        """From now on, request a selection whenever the last one was answered."""
        self.is_selecting = True

        def call(answered) -> None:
            self.num_selections += answered is not None
            if self.is_selecting:
                self.calls.call_async(Trigger.Request()).add_done_callback(call)

        call(None)

    def call(self, client=None, request=None):
        """Call a service, by default `select_features`, and return its reply."""
        future = (client or self.calls).call_async(request or Trigger.Request())
        self.until(future.done, 'the service answered')
        return future.result()

    def measured(self) -> np.ndarray:
        """Return the latencies since the last call, in ms."""
        self.rest(0.5)
        latencies, self.latencies = self.latencies, []
        self._sent_at.clear()
        return np.array(latencies)

    def numbers_in(self, path: Path) -> list[list[int]]:
        """Return the episodes of a file; raise unless each was sent exactly so."""
        saved = read_episodes(path, max_episodes=10**6, max_bytes=10**10)
        found = [episode.rewards.astype(int).tolist() for episode in saved.episodes]
        for episode, numbers in zip(saved.episodes, found, strict=True):
            whole = list(range(numbers[0], numbers[0] + LENGTH))
            if numbers != whole or numbers[0] % LENGTH or numbers != episode.states[:, 0].tolist():
                raise CommandError(f'an episode that was never sent is in the buffer: {numbers}')
        return found


@contextmanager
def robot_and(*nodes: Process, listens: bool = True) -> Iterator[Robot]:
    """Provide a robot for some nodes, and end them all."""
    with ExitStack() as stack:
        for node in nodes:
            stack.enter_context(node)
        robot = Robot(listens)
        try:
            yield robot
        finally:
            robot.close()
