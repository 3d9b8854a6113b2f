# SPDX-License-Identifier: Apache-2.0

"""`selected_state` in one message, and as names and values apart: the same."""

import json
import os
from math import nan

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, String

from cmifs_ros.core import Episode
from cmifs_ros.ros import conversions
from cmifs_ros.ros.qos import LATCHED_QOS, STREAM_QOS

NAMES = ('a', 'b', 'c')
ROBOT = 'step: {topic: /a}\nchannels: {a: /a.data, b: /b.data}\nreward: a\nepisode: {steps: 5}\n'
#: Other than LATCHED_QOS, none of several that come at once is overwritten.
ALL_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Apart:
    """Keep names and values as they come."""

    def __init__(self, robot, messages):
        self._robot = robot
        self.names, self.values = [], []
        for topic, kind, kept, qos in (
            ('names', messages.Keys, self.names, ALL_QOS),
            ('values', messages.Float64Values, self.values, STREAM_QOS),
        ):
            robot.node.create_subscription(kind, f'selected_state/{topic}', kept.append, qos)

    def announced(self):
        """Return number and names as they were published."""
        return [(msg.header.frame_id, list(msg.keys)) for msg in self.names]

    def states(self):
        """Return number, names and values by stamp of what came in both forms; they are equal."""
        found = {}
        whole = {stamp_of(msg): msg for msg in self._robot.selected}
        for msg in self.values:
            stamp = stamp_of(msg)
            if stamp in whole:
                state = whole[stamp]
                assert msg.header == state.header
                assert msg.values.tobytes() == state.position.tobytes()
                found[stamp] = state.header.frame_id, list(state.name), msg.values.tolist()
        return found


@pytest.fixture
def apart(robot):
    return Apart(
        robot, pytest.importorskip('control_msgs.msg', reason='control_msgs is not installed')
    )


def stamp_of(msg):
    return conversions.stamp_to_nanoseconds(msg.header.stamp)


def test_of_a_sampler(start, robot, apart, tmp_path):
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    start('sampler_node', robot_file=tmp_path / 'robot.yaml', control_msgs=True)
    announced, states = apart.announced, apart.states
    publishers = [robot.node.create_publisher(Float64, f'/{name}', 10) for name in 'ba']
    selection = robot.node.create_publisher(String, 'selection', LATCHED_QOS)

    def until(number, names, values):
        def is_there():
            for publisher, value in zip(publishers, (2.0, 1.0), strict=True):
                publisher.publish(Float64(data=value))
            return (number, names, values) in states().values() and (number, names) in announced()

        robot.until(is_there)

    until('', ['a', 'b'], [1, 2])
    for number in (7, 8):
        selection.publish(String(data=json.dumps({'number': number, 'names': ['b']})))
        until(str(number), ['b'], [2])
    expected = [('', ['a', 'b']), ('7', ['b']), ('8', ['b'])]
    assert announced() == expected
    assert all((number, names) in expected for number, names, _ in states().values())
    late = robot.latched('selected_state/names', type(apart.names[0]))
    assert (late.header.frame_id, list(late.keys)) == expected[-1]
    # The names are those of the first values that came with their number.
    firsts = {number: min(stamp_of(m) for m in robot.selected if m.header.frame_id == number)
              for number, _ in expected}  # fmt: skip
    assert [stamp_of(msg) for msg in apart.names[1:]] == [firsts['7'], firsts['8']]


def test_of_a_selector_that_relays(start, robot, apart):
    start('selector_node', selection_period=0.0, num_features=1, control_msgs=True)
    robot.wait_for_selector()
    robot.until(lambda: robot.node.count_publishers('selected_state/values'))
    stamp = 10**12

    def relayed(names, values):
        nonlocal stamp
        stamp += 1
        robot.publish_state(stamp, names, values)
        robot.until(lambda: stamp in apart.states())
        return apart.states()[stamp]

    def is_heard():  # States may come in one form only until all subscriptions are discovered.
        robot.publish_state(1, NAMES, [1.0, 2.0, 3.0])
        return apart.states() and apart.announced()

    robot.until(is_heard)
    assert relayed(('c', 'a'), [3.0, 1.0]) == ('', ['c', 'a'], [3, 1])
    assert relayed(NAMES, [1.0, 2.0, 3.0]) == ('', [*NAMES], [1, 2, 3])

    rng = np.random.default_rng(0)
    states = rng.normal(size=(24, 3, 3))
    robot.publish_episodes([Episode(s, s[:, 2]) for s in states], NAMES, begin=10**6)
    robot.wait_for_episodes(24)
    found = json.loads(robot.call(robot.select_client).message)
    number = str(found['number'])
    assert relayed(('c', 'b', 'a'), [3.0, 2.0, 1.0]) == (number, ['c'], [3])
    assert robot.set_parameter('layout', 'full').successful
    for c in (3.0, 4.0):
        number_, names, values = relayed(NAMES, [1.0, 2.0, c])
        assert (number_, names) == (number, [*NAMES])
        np.testing.assert_equal(values, [nan, nan, c])
    expected = [
        ('', [*NAMES]), ('', ['c', 'a']), ('', [*NAMES]), (number, ['c']), (number, [*NAMES]),
    ]  # fmt: skip
    robot.until(lambda: len(apart.names) >= len(expected))
    assert apart.announced() == expected


@pytest.mark.parametrize(
    ('node', 'installed'),
    [('sampler_node', 'control_msgs'), ('selector_node', 'control_msgs/msg')],
)
def test_without_these_messages_a_node_ends_with_the_remedy(
    start, tmp_path, monkeypatch, node, installed
):
    # No messages, or an older version: in front of the one that may be there.
    for folder in ('control_msgs', installed):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / '__init__.py').touch()
    path = os.environ.get('PYTHONPATH', '')
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}{os.pathsep}{path}')
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    needed = {'robot_file': tmp_path / 'robot.yaml'} if node == 'sampler_node' else {}
    ended = start(node, control_msgs=True, **needed)
    assert ended.process.wait(20) == 2
    assert ended.output == (
        'control_msgs is true, but the package control_msgs, 5.6.0 or newer, is not installed; set '
        'it to false, or: sudo apt install ros-jazzy-control-msgs\n'
    )
