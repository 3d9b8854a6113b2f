"""Inject faults and load into a running selector; print what was lost, as a Markdown table."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32MultiArray
from std_srvs.srv import Trigger

from cmifs_ros.ros import conversions
from cmifs_ros.ros.run_node import make_executor

from .demo import executable

NUM_CHANNELS = 14
NAMES = [f'channel_{i}' for i in range(NUM_CHANNELS)]
FIELDS = ['reward', 'terminated', 'truncated', 'episode', 'step']
LENGTH = 20  # steps of an episode
QOS = QoSProfile(depth=20_000)

_TEXTS = ('a', 'b', 'c', 'reward', 'step', '', 'ä', '\U0001f916', 'x' * 1000, '\n', 'a' * 257)
_VALUES = (0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e17, 0.5)


def random_message(rng: np.random.Generator, names: tuple[str, ...]) -> JointState:
    """Return a message of arbitrary content; its first names are often these."""
    msg = JointState()
    wide = rng.random() < 0.5
    msg.header.stamp.sec = int(rng.integers(-(2**31), 2**31) if wide else rng.integers(3))
    msg.header.stamp.nanosec = int(rng.integers(2**32) if wide else rng.integers(20))
    msg.header.frame_id = str(rng.choice(_TEXTS))
    if rng.random() < 0.5:
        msg.name = list(names[: rng.integers(len(names) + 1)])
    else:
        size = 5000 if rng.random() < 0.005 else rng.integers(8)
        msg.name = [str(text) for text in rng.choice(_TEXTS, size=size)]
    size = len(msg.name) if rng.random() < 0.9 else rng.integers(8)
    msg.position = (rng.choice(_VALUES, size) if wide else rng.normal(size=size)).tolist()
    msg.velocity = rng.choice(_VALUES, size=rng.integers(3)).tolist()
    return msg


def random_state(rng: np.random.Generator) -> JointState:
    """Return a message for `state` of arbitrary content."""
    return random_message(rng, ('a', 'b', 'c'))


def random_reward(rng: np.random.Generator) -> JointState:
    """Return a message for `reward` of arbitrary content."""
    return random_message(rng, tuple(FIELDS))


class SoakError(RuntimeError):
    """A promise was not kept; the message says which."""


class Process:
    """A node in a process of its own; leaving the context ends it."""

    def __init__(self, folder: Path, *command: str, **parameters):
        settings = [w for k, v in parameters.items() for w in ('-p', f'{k}:={json.dumps(v)}')]
        self.log = folder / f'{len(list(folder.iterdir()))}.log'
        with self.log.open('w') as output:
            self._process = subprocess.Popen(
                [*command, '--ros-args', *settings], stdout=output, stderr=subprocess.STDOUT
            )
        self.pid = self._process.pid

    @classmethod
    def selector(cls, folder: Path, **parameters) -> Process:
        """Start the selector as a user would."""
        return cls(folder, executable('selector_node'), **parameters)

    @classmethod
    def bare(cls, folder: Path, node: str, executor: str = 'chosen', **parameters) -> Process:
        """Start one of `bare_nodes`."""
        command = (sys.executable, '-m', 'cmifs_ros.tools.bare_nodes', node, executor)
        return cls(folder, *command, **parameters)

    def cpu_seconds(self) -> float:
        """Return the processor time used so far, without that of the worker."""
        fields = Path(f'/proc/{self.pid}/stat').read_text().rsplit(')', 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def resident_bytes(self) -> int:
        """Return the memory in use."""
        pages = int(Path(f'/proc/{self.pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE')

    def kill(self) -> None:
        """Kill it as nothing can be prepared for."""
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Process:
        """Return itself."""
        return self

    def __exit__(self, kind, *_) -> None:
        """End it; a traceback in its output is a broken promise."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(2)
            except subprocess.TimeoutExpired:
                self.kill()
                if kind is None:
                    raise SoakError(f'not ended within 2 s:\n{self.log.read_text()}') from None
        if kind is None and 'Traceback' in self.log.read_text():
            raise SoakError(self.log.read_text())


class Robot:
    """Publish numbered transitions, and listen to what the selector says.

    The first channel and the reward of a transition are its number, so that each episode that
    was collected tells where it comes from.
    """

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('soak', context=self.context)
        self.executor = make_executor(self.context)
        self.executor.add_node(self.node)
        self.states = self.node.create_publisher(JointState, 'state', QOS)
        self.rewards = self.node.create_publisher(JointState, 'reward', QOS)
        self.calls = self.node.create_client(Trigger, 'select_features', qos_profile=QOS)
        self.clear = self.node.create_client(Trigger, 'selector/clear_episodes')
        self.latencies: list[float] = []
        self.counts = [0, 0]
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.levels: dict[str, tuple[bytes, str]] = {}
        self.number = 0
        self._rng = np.random.default_rng(0)
        self._sent_at: dict[int, int] = {}
        for kind, topic, callback, qos in (
            (JointState, 'selected_state', self._on_selected, QOS),
            (DiagnosticArray, '/diagnostics', self._on_diagnostics, 10),
            (Int32MultiArray, 'counts', self._on_counts, 1),
        ):
            self.node.create_subscription(kind, topic, callback, qos)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_selected(self, msg: JointState) -> None:
        sent_at = self._sent_at.pop(conversions.stamp_to_nanoseconds(msg.header.stamp), None)
        if sent_at is not None:
            self.latencies.append((time.monotonic_ns() - sent_at) / 1e6)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            self.diagnostics[status.name] = {pair.key: pair.value for pair in status.values}
            self.levels[status.name] = (status.level, status.message)

    def _on_counts(self, msg: Int32MultiArray) -> None:
        self.counts = list(msg.data)

    def until(self, condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
        """Spin until a condition holds; raise if it does not in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                raise SoakError(f'waited in vain until {what}; {self.levels} {self.diagnostics}')
            self.executor.spin_once(0.05)

    def rest(self, seconds: float) -> None:
        """Spin for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(left)

    def wait_for(self, output: str) -> None:
        """Wait until a node that publishes a topic listens."""
        self.diagnostics.clear()
        self.until(
            lambda: (
                self.states.get_subscription_count()
                and self.node.count_publishers(output)
                and (output == 'counts' or self.rest(0.2) is None)
            ),
            'the node is there',
        )
        if output == 'selected_state' and self.rewards.get_subscription_count():
            self.until(lambda: self.input and self.calls.service_is_ready(), 'the selector is')
        self.rest(1.0)

    @property
    def input(self) -> dict[str, str]:
        """What the selector says of its input."""
        return self.diagnostics.get('selector: input', {})

    @property
    def selection(self) -> dict[str, str]:
        """What the selector says of its selection."""
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

    def run(self, rate: float, count: int) -> None:
        """Publish whole episodes at a rate, in transitions a second."""
        begin = time.monotonic()
        for sent in range(count):
            while (left := begin + sent / rate - time.monotonic()) > 0:
                self.executor.spin_once(left)
            state, reward = self.transition()
            self._sent_at[self.number] = time.monotonic_ns()
            self.states.publish(state)
            self.rewards.publish(reward)

    def call(self, client=None, seconds: float = 60.0) -> Trigger.Response:
        """Call a service and return its reply."""
        future = (client or self.calls).call_async(Trigger.Request())
        self.until(future.done, 'the service answered', seconds)
        return future.result()

    def measured(self) -> np.ndarray:
        """Return the latencies since the last call, in ms."""
        self.rest(0.5)
        latencies, self.latencies = self.latencies, []
        self._sent_at.clear()
        return np.array(latencies)
