"""Inject faults and load into a running selector; print what was lost, as a Markdown table."""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
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

from cmifs_ros.collect import episode_file
from cmifs_ros.ros import conversions
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools.demo import executable

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

    def __init__(self, folder: Path, *command: str, namespace: str = '/', **parameters):
        settings = [w for k, v in parameters.items() for w in ('-p', f'{k}:={json.dumps(v)}')]
        settings += ['-r', f'__ns:={namespace}']
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
        command = (sys.executable, '-m', 'studies.soak.bare_nodes', node, executor)
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
        """Leave the graph."""
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
        """Wait until the node that publishes a topic is there and listens."""
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
        """From now on, call for a selection whenever the last is answered."""
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
        """Return the episodes of a file, and raise unless each of them was sent as it is."""
        saved = episode_file.read(path, max_episodes=10**6, max_bytes=10**10)
        found = [episode.rewards.astype(int).tolist() for episode in saved.episodes]
        for episode, numbers in zip(saved.episodes, found, strict=True):
            whole = list(range(numbers[0], numbers[0] + LENGTH))
            if numbers != whole or numbers[0] % LENGTH or numbers != episode.states[:, 0].tolist():
                raise SoakError(f'an episode that was never sent is in the buffer: {numbers}')
        return found


@contextmanager
def robot_and(*nodes: Process, listens: bool = True) -> Iterator[Robot]:
    """Give a robot to some nodes, and end them all."""
    with ExitStack() as stack:
        for node in nodes:
            stack.enter_context(node)
        robot = Robot(listens)
        try:
            yield robot
        finally:
            robot.close()


def quantiles(latencies: np.ndarray) -> str:
    """Return p50 and p99 as text."""
    p50, p99 = np.percentile(latencies, (50, 99))
    return f'p50 {p50:.2f} ms, p99 {p99:.2f} ms'


def ratios(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Return the ratios of p50 and p99 as text."""
    p50, p99 = np.percentile(ours, (50, 99)) / np.percentile(theirs, (50, 99))
    return f'{p50:.2f} times and {p99:.2f} times'


class Soak:
    """The faults and loads; each method yields rows of the table.

    Parameters
    ----------
    folder : Path
        For files and logs.
    scale : float
        1 for the full run; less takes as much less time.

    """

    def __init__(self, folder: Path, scale: float):
        self.folder = folder
        self.scale = scale

    def count(self, full: int) -> int:
        """Return a number of repetitions, of which there are fewer in a short run."""
        return max(1, round(full * self.scale))

    def executors(self):
        """Compare the executors: the same nodes, the same messages, in turns."""
        for node in ('relay', 'selector'):
            found = {}
            for executor in ('single', 'chosen') * 2:
                process = Process.bare(self.folder, node, executor, selection_period=0.0)
                with robot_and(process) as robot:
                    robot.wait_for('selected_state')
                    used, begin = process.cpu_seconds(), time.monotonic()
                    robot.run(500, self.count(5000))
                    share = (process.cpu_seconds() - used) / (time.monotonic() - begin)
                    latencies, shares = found.setdefault(executor, ([], []))
                    latencies.append(robot.measured())
                    shares.append(share)
            for executor, (latencies, shares) in found.items():
                name = 'SingleThreadedExecutor' if executor == 'single' else 'the chosen executor'
                yield (
                    f'500 transitions/s, {node} in {name}',
                    f'{sum(map(len, latencies))} transitions',
                    f'{quantiles(np.concatenate(latencies))}, {np.mean(shares):.0%} of a core',
                )

    def load(self):
        """1 kHz, with selections back to back, against a bare relay in turns of 5 s."""
        path = self.folder / 'load'
        selector = Process.selector(self.folder, selection_period=0.0, episodes_path=str(path))
        relay = Process.bare(self.folder, 'relay', namespace='/relay')
        with robot_and(selector, relay) as robot:
            robot.wait_for('selected_state')
            robot.wait_for('/relay/selected_state')
            for is_busy in (False, True):
                latencies, shares = {'': [], '/relay': []}, {'': [], '/relay': []}
                begin_number = robot.number
                robot.run(1000, 2000)  # as many episodes as are kept
                robot.measured()
                if is_busy:
                    robot.select_back_to_back()
                for _ in range(self.count(12 if is_busy else 6)):
                    for to, process in (('', selector), ('/relay', relay)):
                        used, begin = process.cpu_seconds(), time.monotonic()
                        robot.run(1000, 5000, to)
                        shares[to].append(
                            (process.cpu_seconds() - used) / (time.monotonic() - begin)
                        )
                        latencies[to].append(robot.measured())
                what = 'with selections back to back' if is_busy else 'without selections'
                count = robot.number - begin_number
                yield (
                    f'1000 transitions/s {what}',
                    f'{count} transitions, {robot.num_selections} selections',
                    self._lost(robot, path),
                )
                ours, theirs = (np.concatenate(latencies[to]) for to in ('', '/relay'))
                yield (
                    f'latency, {what}',
                    f'{len(ours)} and {len(theirs)} states',
                    f'{quantiles(ours)}; bare relay {quantiles(theirs)}: {ratios(ours, theirs)}',
                )
                yield (
                    f'processor, {what}',
                    '',
                    f'{np.mean(shares[""]):.0%} of a core; '
                    f'bare relay, which gets no rewards, {np.mean(shares["/relay"]):.0%}',
                )
            robot.is_selecting = False

    def _lost(self, robot: Robot, path: Path) -> str:
        """Return what was lost of all that was sent to a selector, of which a file tells."""
        robot.rest(2.5)
        lost = robot.number - int(robot.input['transitions'])
        drops = {k: v for k, v in robot.input.items() if 'dropped' in k}
        sent = list(range(robot.number))
        newest = [sent[i : i + LENGTH] for i in range(0, len(sent), LENGTH)][-100:]
        kept = robot.numbers_in(path)[-100:]  # what would come back
        same = 'equal those sent' if kept == newest else 'DIFFER from those sent'
        return f'{lost} lost{f", {drops}" if drops else ""}; the 100 buffered episodes {same}'

    def rates(self):
        """Find the highest rate without loss, of the selector and of a bare subscriber."""
        best = {}
        for node, output in (('counter', 'counts'), ('selector', 'selected_state')):
            start = Process.selector if node == 'selector' else partial(Process.bare, node=node)
            process = start(self.folder, selection_period=0.0)
            # The sender has enough to do: nobody listens to the selected states.
            with robot_and(process, listens=False) as robot:
                robot.wait_for(output)
                rate = 1000.0
                while True:
                    before, begin = robot.number, time.monotonic()
                    robot.run(rate, self.count(int(4 * rate)))
                    achieved = (robot.number - before) / (time.monotonic() - begin)
                    robot.rest(3.0)
                    got = (
                        min(robot.counts) if node == 'counter' else int(robot.input['transitions'])
                    )
                    if got < robot.number or achieved < 0.95 * rate:
                        why = f'{robot.number - got} lost at {rate:.0f}/s'
                        if got == robot.number:
                            why = f'the sender cannot do more than {achieved:.0f}/s'
                        break
                    best[node] = achieved
                    rate *= 1.15
                yield (
                    f'highest rate without loss, {node}',
                    '4 s a rate, each 15 % above the last',
                    f'{best.get(node, 0):.0f} transitions/s ({why})',
                )
        share = best.get('selector', 0) / best['counter']
        yield 'the same, selector against bare counter', '', f'{share:.0%}'

    def million(self):
        """Collect a million transitions; the memory must not grow."""
        total = self.count(1_000_000)
        path = self.folder / 'million'
        process = Process.selector(
            self.folder, selection_period=5.0, num_features=1, episodes_path=str(path)
        )
        with robot_and(process, listens=False) as robot:
            robot.wait_for('selected_state')
            sizes, slowest = [], 0.0
            begin = time.monotonic()
            for _ in range(50):
                robot.run(3000, total // 50 // LENGTH * LENGTH)
                asked = time.monotonic()
                robot.call(robot.parameters, ListParameters.Request())
                slowest = max(slowest, time.monotonic() - asked)
                robot.diagnostics.clear()
                robot.until(lambda: robot.input, 'diagnostics came')
                robot.measured()
                sizes.append(process.resident_bytes())
            full = sizes[4]
            yield (
                'a million transitions' if self.scale == 1 else 'many transitions',
                f'{robot.number} in {time.monotonic() - begin:.0f} s',
                f'{self._lost(robot, path)}; memory {full / 1e6:.1f} MB after a tenth, '
                f'{sizes[-1] / 1e6:.1f} MB at the end ({sizes[-1] / full - 1:+.1%}), at most '
                f'{max(sizes) / 1e6:.1f} MB; a service answered within {slowest:.2f} s',
            )

    def calls(self):
        """Call the service a hundred times at once."""
        with robot_and(Process.selector(self.folder, selection_period=0.0)) as robot:
            robot.wait_for('selected_state')
            robot.run(1000, 50 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '50', '50 episodes are there')
            answers = [robot.calls.call_async(Trigger.Request()) for _ in range(100)]
            robot.until(lambda: all(a.done() for a in answers), 'all calls are answered')
            replies = [a.result() for a in answers]
            yield (
                'concurrent calls of select_features',
                '100',
                f'{sum(r.success for r in replies)} answered with success, by '
                f'{len({r.message for r in replies})} computations',
            )

    def workers(self):
        """Kill the worker, idle and in the middle."""
        process = Process.selector(self.folder, selection_period=0.0, num_features=3)
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            robot.run(1000, 100 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '100', '100 episodes are there')
            for state, times in (('idle', self.count(10)), ('computing', self.count(10))):
                told = recovered = 0
                for _ in range(times):
                    if state == 'idle':
                        robot.call()
                        answer = None
                    else:
                        answer = robot.calls.call_async(Trigger.Request())
                    self._kill_worker(robot, state)
                    if answer is None:
                        robot.until(lambda: robot.selection['worker pid'] == 'none', 'it is seen')
                        told += 1
                    else:
                        robot.until(answer.done, 'the call is answered')
                        told += 'the worker process died' in answer.result().message
                    recovered += robot.call().success
                yield (
                    f'worker killed (-9), {state}',
                    f'{times}',
                    f'{told} noticed, {recovered} next selections succeeded, '
                    f'{robot.input["episodes"]} of 100 episodes kept',
                )

    def _kill_worker(self, robot: Robot, state: str) -> None:
        robot.diagnostics.clear()
        robot.until(
            lambda: (
                robot.selection.get('worker') == state and robot.selection['worker pid'] != 'none'
            ),
            f'the worker is {state}',
        )
        os.kill(int(robot.selection['worker pid']), signal.SIGKILL)

    def restarts(self):
        """Kill the selector at random moments and start it again."""
        path = self.folder / 'restarts'
        rng = np.random.default_rng(0)
        times, number, total, lost = self.count(20), 0, 0, []
        for _ in range(times):
            process = Process.selector(
                self.folder, selection_period=1.0, num_features=1, min_episodes=2,
                max_episodes=100_000, episodes_path=str(path),
            )  # fmt: skip
            with robot_and(process) as robot:
                robot.number = number
                robot.wait_for('selected_state')
                kept = len(robot.numbers_in(path)) if path.exists() else 0
                if int(robot.input['episodes']) != kept:
                    raise SoakError(f'{kept} episodes were saved, but {robot.input} came back')
                robot.run(200, int(rng.integers(200, 800)))
                process.kill()
                # A transition was taken for sure if the state after the next one was relayed.
                finished = (robot.newest_relayed - 1) // LENGTH - number // LENGTH
                number = -(-robot.number // LENGTH) * LENGTH
            lost.append(max(0, finished - (len(robot.numbers_in(path)) - kept)))
            total += finished
        yield (
            'selector killed (-9) while collecting 200 transitions/s',
            f'{times}',
            f'{sum(lost)} finished episodes lost (at most {max(lost)} at once) of '
            f'{total}; all that came back were sent as they are',
        )

    def messages(self):
        """Lose, repeat and delay messages."""
        path = self.folder / 'messages'
        process = Process.selector(
            self.folder, selection_period=0.0, max_episodes=100_000, episodes_path=str(path)
        )
        rng = np.random.default_rng(0)
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            episodes = self.count(1000)
            late = []
            counts = {'dropped': 0, 'repeated': 0, 'delayed': 0}
            for _ in range(episodes * LENGTH):
                now, delayed = [], []
                for sent in zip((robot.states, robot.rewards), robot.transition(), strict=True):
                    fault = rng.choice([*counts, ''], p=[0.01, 0.01, 0.01, 0.97])
                    if fault:
                        counts[fault] += 1
                    now += {'dropped': 0, 'repeated': 2, 'delayed': 0, '': 1}[fault] * [sent]
                    delayed += [sent] * (fault == 'delayed')
                for publisher, msg in now + late:
                    publisher.publish(msg)
                late = delayed
                robot.rest(0.0005)
            robot.rest(3.0)
            kept = len(robot.numbers_in(path))
            drops = [int(n) for key, n in robot.input.items() if key.startswith('episodes dropped')]
            yield (
                'messages dropped, repeated, delayed past the next, 1 % each',
                ', '.join(f'{n} {what}' for what, n in counts.items()) + f' in {episodes} episodes',
                f'{kept} episodes collected, each as it was sent; {sum(drops)} counted as dropped',
            )

    def fuzz(self):
        """Send messages of the right type and arbitrary content."""
        total = self.count(100_000)
        rng = np.random.default_rng(0)
        with robot_and(Process.selector(self.folder, selection_period=0.5)) as robot:
            robot.wait_for('selected_state')
            for _ in range(total // 2):
                robot.states.publish(random_state(rng))
                robot.rewards.publish(random_reward(rng))
                robot.executor.spin_once(0)
            robot.rest(3.0)
            robot.call(robot.clear)
            before = int(robot.input['transitions'])
            robot.run(500, 25 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '25', '25 episodes are there')
            success = robot.call().success
            causes = sum('messages dropped' in key for key in robot.input)
            yield (
                'random messages',
                f'{total}',
                f'no exception; {before} pairs made of them, {causes} causes counted; afterwards '
                f'25 of 25 episodes collected, selection {"succeeded" if success else "FAILED"}',
            )

    def disk(self):
        """Fill the disk and free it again."""
        path = self.folder / 'disk'
        process = Process.selector(self.folder, selection_period=0.0, episodes_path=str(path))
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            robot.run(500, 2 * LENGTH)
            robot.until(path.exists, 'a file is there')
            unlimited = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
            limit = (path.stat().st_size, unlimited[1])
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, limit)
            storage = 'selector: storage'
            robot.run(500, 50 * LENGTH)
            robot.until(lambda: robot.levels[storage][0] == b'\x02', 'the error is told')
            told = robot.levels[storage][1].rpartition(': ')[2]
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, unlimited)
            robot.until(lambda: robot.levels[storage][0] == b'\x00', 'it is saved')
            yield (
                'no room for the file (RLIMIT_FSIZE)',
                'while 50 episodes came',
                f'reported ({told}); {len(robot.numbers_in(path))} of 52 episodes saved once there '
                'was room',
            )


PARTS = tuple(name for name, value in vars(Soak).items() if callable(value) and name[0] != '_'
              and name != 'count')  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run the soak; return the exit code."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument('parts', nargs='*', metavar='PART', help=f'of {", ".join(PARTS)}; or all')
    parser.add_argument('--scale', type=float, default=1.0, help='1: the full run; less is shorter')
    options = parser.parse_args(arguments)
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f'{", ".join(sorted(unknown))}; expected some of {", ".join(PARTS)}')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    # Leaves all contexts, and so ends the nodes.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    print('| injected | how often | lost or measured |\n|---|---|---|', flush=True)
    with tempfile.TemporaryDirectory(prefix='cmifs_soak_') as folder:
        soak = Soak(Path(folder), options.scale)
        try:
            for part in options.parts or PARTS:
                for row in getattr(soak, part)():
                    print(f'| {" | ".join(row)} |', flush=True)
        except SoakError as error:
            print(f'soak: {error}', file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
