# SPDX-License-Identifier: Apache-2.0

"""A controller on `selected_state`, while all happens that happens to a robot in weeks."""

from __future__ import annotations

import json
import math
import time
from collections import Counter

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import Executor
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.ros import conversions
from cmifs_ros.ros.qos import LATCHED_QOS, STREAM_QOS
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools.processes import executable
from studies.nodes.process import Process

from .part import Part, quantiles

#: Two sensors that are the reward in turn, and two that never are.
TOPICS = ('a', 'b', 'c', 'd')
ROBOT_FILE = f"""
step: {{topic: /step}}
channels: {{{', '.join(f'{t}: {{path: /{t}.point.x, max_age: 0.5}}' for t in TOPICS)}}}
values: {{gain: /step.point.x}}
reward: gain
episode: {{steps: 100}}
saving: {{after: 2, explore_every: 40, explore_episodes: 20}}
"""
RATE = 100
#: Seconds between changes of the task, silences and resets, and that a silence lasts.
_TASK, _SILENCES, _RESETS, _SILENCE = 240.0, 20.0, 70.0, 2.0
#: Milliseconds after which a message is of no use to control.
_OLD = 50
#: Seconds after a silence, or after it is switched on, in which a channel may still be missing.
_BACK = 0.5


class Robot:
    """Publish numbers at 100 Hz in simulated time, and receive what a controller would.

    Attributes
    ----------
    ages : dict of str to dict of int to float
        By topic and stamp, how old each message was as it came, in ms since its step was published.
    counts : collections.Counter
        Of what has happened.

    """

    def __init__(self, seed: int = 0):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = node = rclpy.create_node('soak', context=self._context)
        self._executor: Executor = make_executor(self._context)
        self._executor.add_node(node)
        self._rng = np.random.default_rng(seed)
        self._clock = node.create_publisher(Clock, '/clock', STREAM_QOS)
        self._topics = {
            name: node.create_publisher(PointStamped, f'/{name}', STREAM_QOS)
            for name in (*TOPICS, 'step')
        }
        self._relayed = node.create_publisher(JointState, '/relay/state', STREAM_QOS)
        self._levels = dict.fromkeys(TOPICS, 0.0)
        self._silent_until = dict.fromkeys(TOPICS, -math.inf)
        self._off_until = dict.fromkeys(TOPICS, -math.inf)
        self._rewarded, self._time = TOPICS[0], 0
        self._sent_at: dict[str, dict[int, float]] = {}
        self.ages: dict[str, dict[int, float]] = {}
        self.counts: Counter[str] = Counter()
        for topic in ('selected_state', '/relay/selected_state'):
            self._sent_at[topic], self.ages[topic] = {}, {}
            node.create_subscription(
                JointState, topic, lambda m, topic=topic: self._receive(topic, m), STREAM_QOS
            )
        self._selected: list[str] | None = None
        node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)
        node.create_subscription(String, 'switched_off', self._on_switched_off, LATCHED_QOS)
        self._reset()

    def _reset(self) -> None:
        # No stamp of a run is one of another.
        self._time = 1000 * SECOND + self.counts['resets'] * 1000

    @property
    def is_heard(self) -> bool:
        """Whether sampler and relay receive the steps, and are received."""
        return (
            self._topics['step'].get_subscription_count() > 0
            and self._relayed.get_subscription_count() > 0
            and all(self._node.count_publishers(topic) for topic in self._sent_at)
        )

    def spin(self, seconds: float) -> None:
        """Receive for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def live(self, seconds: float, watch) -> None:
        """Publish for a while; `watch` is called every ten seconds."""
        begin = due = time.monotonic()
        next_at = {self._change_task: _TASK, self._silence: _SILENCES, self._set_back: _RESETS}
        next_at[watch] = 10.0
        periods = dict(next_at)
        while due < begin + seconds:
            for act, at in next_at.items():
                if due >= begin + at:
                    next_at[act] += periods[act]
                    act()
            self._step()
            due += 1 / RATE
            self.spin(due - time.monotonic())
        self.spin(2.0)

    @property
    def num_lost(self) -> dict[str, int]:
        """By topic, how many steps were never received."""
        return {topic: len(sent) for topic, sent in self._sent_at.items()}

    def forget(self) -> None:
        """Count from now on."""
        self.counts.clear()
        for topic, sent in self._sent_at.items():
            sent.clear()
            self.ages[topic].clear()

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _change_task(self) -> None:
        self._rewarded = TOPICS[1 - TOPICS.index(self._rewarded)]
        self.counts['changes of the task'] += 1

    def _silence(self) -> None:
        name = TOPICS[self._rng.integers(len(TOPICS))]
        self._silent_until[name] = time.monotonic() + _SILENCE
        self.counts['silences'] += 1

    def _set_back(self) -> None:
        self.counts['resets'] += 1
        self._reset()

    def _step(self) -> None:
        self._time += SECOND // RATE
        stamp = conversions.stamp_from_nanoseconds(self._time)
        gain, now = self._levels[self._rewarded], time.monotonic()
        self._clock.publish(Clock(clock=stamp))
        message = PointStamped(header=Header(stamp=stamp))
        for name, level in self._levels.items():
            message.point.x = self._levels[name] = 0.97 * level + self._rng.normal(0, 0.25)
            if now >= self._silent_until[name]:
                self._topics[name].publish(message)
        message.point.x = gain + self._rng.normal(0, 0.1)
        for sent in self._sent_at.values():
            sent[self._time] = time.monotonic()
        self._relayed.publish(JointState(header=message.header, name=['x'], position=[gain]))
        self._topics['step'].publish(message)
        self.counts['steps'] += 1

    def _receive(self, topic: str, message: JointState) -> None:
        now, stamp = time.monotonic(), conversions.stamp_to_nanoseconds(message.header.stamp)
        sent_at = self._sent_at[topic].pop(stamp, None)
        if sent_at is not None:
            self.ages[topic][stamp] = (now - sent_at) * 1000
        if topic == 'selected_state':
            for name, value in zip(message.name, message.position, strict=True):
                if math.isnan(value):
                    is_silent = now < self._silent_until[name] + _BACK
                    is_off = now < self._off_until[name] + _BACK
                    cause = 'silent' if is_silent else 'off' if is_off else 'no cause'
                    self.counts[f'nan, {cause}'] += 1

    def _on_selection(self, message: String) -> None:
        found = json.loads(message.data)
        names = sorted(found['names'])
        self.counts['selections'] += not found['doubt']
        self.counts['selections that differ'] += names != self._selected
        self._selected = names

    def _on_switched_off(self, message: String) -> None:
        off, now = json.loads(message.data), time.monotonic()
        self.counts['times switched off'] += bool(off)
        for name, until in self._off_until.items():
            self._off_until[name] = math.inf if f'/{name}' in off else min(until, now)


class Control(Part):
    """What a controller gets, for an hour."""

    def control(self):
        """Receive at 100 Hz beside selections, silences, resets, and topics switched off."""
        minutes = 60 * self.scale
        path = self.folder / 'robot.yaml'
        path.write_text(ROBOT_FILE)
        selector = Process.selector(self.folder, selection_period=30.0, use_sim_time=True)
        command = executable('sampler_node')
        sampler = Process(self.folder, command, robot_file=str(path), use_sim_time=True)
        with selector, sampler, self.bare('relay', namespace='/relay'):
            robot = Robot()
            try:
                while not robot.is_heard:
                    robot.spin(0.1)
                robot.live(5.0, lambda: None)  # They find the other topics.
                robot.forget()
                sizes: list[tuple[int, int]] = []
                robot.live(
                    60 * minutes,
                    lambda: sizes.append((selector.resident_bytes(), sampler.resident_bytes())),
                )
                yield from _rows(robot, sizes, minutes)
            finally:
                robot.close()


def _rows(robot: Robot, sizes: list[tuple[int, int]], minutes: float):
    counts, lost = robot.counts, robot.num_lost
    yield (
        f'controller on `selected_state` at {RATE} Hz, {minutes:g} minutes',
        f'{counts["steps"]} steps, {counts["selections"]} selections '
        f'({counts["selections that differ"]} differ from the one before), '
        f'{counts["changes of the task"]} changes of the task, {counts["silences"]} silences of a '
        f'topic, {counts["resets"]} resets of simulated time, {counts["times switched off"]} times '
        'topics switched off',
        f'{lost["selected_state"]} lost (bare relay {lost["/relay/selected_state"]}); NaN '
        f'{counts["nan, silent"]} times while the selected topic was silent, '
        f'{counts["nan, off"]} times when it had been switched off until it was selected, '
        f'{counts["nan, no cause"]} times else',
    )
    of_sampler, of_relay = robot.ages['selected_state'], robot.ages['/relay/selected_state']
    both = sorted(of_sampler.keys() & of_relay.keys())
    ours, theirs = (np.array([of[stamp] for stamp in both]) for of in (of_sampler, of_relay))
    yield (
        'age of `selected_state` as it is received',
        f'{len(both)} messages',
        f'{quantiles(ours)}, at most {ours.max():.1f} ms; bare relay {quantiles(theirs)}, at most '
        f'{theirs.max():.1f} ms; {np.sum(ours > _OLD)} older than {_OLD} ms, of which '
        f"{np.sum((ours > _OLD) & (theirs <= _OLD))} where the bare relay's was not",
    )
    tenth = sizes[len(sizes) // 10]
    told = [
        f'{name} {then / 1e6:.1f} MB after a tenth, {now / 1e6:.1f} MB at the end '
        f'({now / then - 1:+.1%}), at most {max(one[i] for one in sizes) / 1e6:.1f} MB'
        for i, (name, then, now) in enumerate(
            zip(('selector', 'sampler'), tenth, sizes[-1], strict=True)
        )
    ]
    yield 'memory meanwhile', '', '; '.join(told)
