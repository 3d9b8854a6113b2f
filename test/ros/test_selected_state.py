# SPDX-License-Identifier: Apache-2.0

"""`selected_state` of a sampler: at once, from the selected channels alone."""

import json
from math import nan

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from cmifs_ros.ros import conversions
from cmifs_ros.ros.qos import LATCHED_QOS

CHANNELS = ['a', 'b', 'c']
FILE = """
step: {topic: /step}
channels: {a: /a.data, b: /b.data, c: {path: /c.data, max_age: .inf}}
values: {never: /never.data}
reward: never
episode: {steps: 10}
"""
SELECTED = 'sampler: selected_state'
UNUSABLE = [
    '[' * 100_000,
    '{"number": 1, "names": [1]}',
    '{"number": [], "names": ["a"]}',
    r'{"number": 1, "names": ["\ud800"]}',  # It cannot be printed.
]
OK, WARN = b'\x00', b'\x01'


class Topics:
    """Topics of one number, each published 50 times a second until it is silenced."""

    def __init__(self, robot, **values):
        self._values = values
        self._publishers = {
            name: robot.node.create_publisher(Float64, f'/{name}', 10) for name in values
        }
        robot.node.create_timer(0.02, self._publish)

    def silence(self, name):
        del self._values[name]

    def speak(self, name, value):
        self._values[name] = value

    def _publish(self):
        for name, value in self._values.items():
            self._publishers[name].publish(Float64(data=value))


@pytest.fixture
def robot_file(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(FILE)
    return path


@pytest.fixture
def say(robot):
    """Publish a text as a selection."""
    publisher = robot.node.create_publisher(String, 'selection', LATCHED_QOS)
    return lambda text: publisher.publish(String(data=text))


@pytest.fixture
def select(say):
    """Publish a selection, as the selector does."""
    return lambda number, *names: say(json.dumps({'number': number, 'names': names}))


def newest(robot):
    """Return names, values and number of the newest message, or nothing."""
    if not robot.selected:
        return None
    msg = robot.selected[-1]
    return list(msg.name), msg.position.tolist(), msg.header.frame_id


def until_newest(robot, names, values, number):
    robot.until(
        lambda: newest(robot) == (names, pytest.approx(values, nan_ok=True), str(number or ''))
    )


def test_it_needs_the_selected_channels_only_and_no_episode(start, robot, robot_file, select, say):
    sampler = start('sampler_node', robot_file=robot_file)
    Topics(robot, step=0.0)
    waits = ', '.join(f'{name}: no message yet' for name in CHANNELS)
    said = f'no selected_state yet; missing: {waits}'
    robot.until(lambda: robot.diagnostics.get(SELECTED, ())[:2] == (WARN, said))
    assert robot.selected == []
    topics = Topics(robot, a=1.0, b=2.0, c=3.0)
    until_newest(robot, CHANNELS, [1, 2, 3], None)
    select(7, 'c', 'a')  # best first
    until_newest(robot, ['a', 'c'], [1, 3], 7)  # in the order of the file
    robot.until(lambda: robot.diagnostics.get(SELECTED, ())[:2] == (OK, 'a, c'))
    assert robot.diagnostics[SELECTED][2]['number'] == '7'
    topics.silence('b')
    robot.until(lambda: robot.diagnostics['sampler: steps'][0] == WARN)
    robot.selected.clear()
    until_newest(robot, ['a', 'c'], [1, 3], 7)
    # No state was ever made: `never` has no publisher, without which nothing can be learned.
    assert robot.diagnostics['sampler: steps'][2]['steps'] == '0'
    robot.until(lambda: 'steps lack never: no message' in sampler.output)

    topics.silence('a')
    until_newest(robot, ['a', 'c'], [nan, 3], 7)
    said = 'selected_state has nan for a: silent for more than its max_age, 1 s'
    robot.until(lambda: robot.diagnostics[SELECTED][:2] == (WARN, said))
    assert sampler.output.count(said) == 1
    topics.speak('a', 4.0)
    until_newest(robot, ['a', 'c'], [4, 3], 7)
    robot.until(lambda: robot.diagnostics[SELECTED][0] == OK)
    assert sampler.output.count('selected_state has all selected channels again') == 1

    for count, text in enumerate(UNUSABLE, start=1):
        say(text)
        robot.until(lambda n=count: sampler.output.count('a selection cannot be read') == n)
    select(8, 'z')
    robot.until(lambda: "the robot file has no channel 'z'" in sampler.output)
    select(9, 'b')
    until_newest(robot, ['b'], [nan], 9)
    select(1, 'c')  # of a selector that was started anew
    until_newest(robot, ['c'], [3], 1)


def test_full_places_stopping_and_nothing_before_the_selection(start, robot, robot_file, select):
    start(
        'sampler_node',
        robot_file=robot_file,
        layout='full',
        pass_through_until_selected=False,
        stop_on_missing_channel=True,
    )
    topics = Topics(robot, a=1.0, b=2.0, c=3.0, step=0.0)
    what = 'nothing before the first selection'
    robot.until(lambda: robot.diagnostics.get(SELECTED, ())[:2] == (OK, what))
    assert robot.diagnostics[SELECTED][2]['messages'] == '0'
    select(7, 'b')
    until_newest(robot, CHANNELS, [nan, 2, nan], 7)
    topics.silence('b')
    said = 'selected_state stops; missing: b: silent for more than its max_age, 1 s'
    robot.until(lambda: robot.diagnostics[SELECTED][:2] == (WARN, said))
    robot.selected.clear()
    topics.speak('b', 5.0)
    until_newest(robot, CHANNELS, [nan, 5, nan], 7)
    assert all(msg.position[1] == 5 for msg in robot.selected)


def test_it_says_so_if_the_topic_of_the_steps_is_silent_or_nothing_is_selected(
    start, robot, robot_file, select
):
    sampler = start('sampler_node', robot_file=robot_file, layout='full')
    topics = Topics(robot, a=1.0, b=2.0, c=3.0, step=0.0)
    select(7, 'c', 'b')
    robot.until(lambda: robot.diagnostics.get(SELECTED, ())[:2] == (OK, 'b, c'))
    assert 'selected_state is now b, c\n' in sampler.output
    topics.silence('step')
    said = 'no step: /step is silent'
    robot.until(lambda: robot.diagnostics[SELECTED][:2] == (WARN, said))
    assert said in sampler.output
    topics.speak('step', 0.0)
    robot.until(lambda: robot.diagnostics[SELECTED][:2] == (OK, 'b, c'))
    assert '/step is heard again' in sampler.output
    select(8)
    said = 'empty: nothing is selected'
    robot.until(lambda: robot.diagnostics[SELECTED][:2] == (OK, said))
    assert f'selected_state is now {said}' in sampler.output


def test_a_selection_made_before_the_sampler_was_started_counts(start, robot, robot_file, select):
    select(7, 'b')
    start('sampler_node', robot_file=robot_file)
    Topics(robot, b=2.0, step=0.0)
    until_newest(robot, ['b'], [2], 7)
    assert all(msg.header.frame_id in ('', '7') for msg in robot.selected)


@pytest.mark.parametrize('first', ['sampler_node', 'selector_node'])
def test_of_sampler_and_selector_the_sampler_alone_publishes_it_in_whichever_order_they_start(
    start, robot, tmp_path, first
):
    path = tmp_path / 'robot.yaml'
    path.write_text('step: {topic: /a}\nchannels: {a: /a.data}\nreward: a\nepisode: {steps: 5}\n')
    parameters = {'sampler_node': {'robot_file': path}, 'selector_node': {'selection_period': 0.0}}
    states = []
    robot.node.create_subscription(JointState, 'state', states.append, 100)
    Topics(robot, a=1.0)
    started = {first: start(first, **parameters.pop(first))}
    robot.until(lambda: robot.diagnostics)
    ((second, given),) = parameters.items()
    started[second] = start(second, **given)
    robot.until(lambda: 'selector: input' in robot.diagnostics)
    robot.until(lambda: robot.value('transitions') > 20)
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][2].get('selected_state comes from') == '/sampler')
    stamps = [conversions.stamp_to_nanoseconds(msg.header.stamp) for msg in robot.selected]
    assert len(stamps) > len(states)  # The states come later.
    assert stamps == sorted(set(stamps))  # Relayed ones would come twice.

    started['sampler_node'].end()
    robot.until(lambda: 'selected_state comes from' not in robot.diagnostics[status][2])
    robot.selected.clear()
    robot.publish_state(5, ['a'], [6.0])
    robot.until(lambda: robot.selected)


def test_steps_of_a_fixed_rate_are_stamped_as_the_states_are(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('step: {rate: 20}\nchannels: {a: /a.data}\nreward: a\n')
    start('sampler_node', robot_file=path)
    states = []
    robot.node.create_subscription(JointState, 'state', states.append, 100)
    Topics(robot, a=1.0)

    def stamps_of(messages):
        return [conversions.stamp_to_nanoseconds(msg.header.stamp) for msg in messages]

    # Of a busy machine a tick may be left out: what comes late is of no use to control.
    robot.until(lambda: len({*stamps_of(states)} & {*stamps_of(robot.selected)}) > 5)
    stamps = stamps_of(robot.selected)
    assert all(stamp % 50_000_000 == 0 for stamp in stamps)
    assert stamps == sorted(set(stamps))


def test_in_simulated_time_the_clock_ticks_also_after_a_reset(start, robot, tmp_path, select):
    path = tmp_path / 'robot.yaml'
    path.write_text('step: {rate: 10}\nchannels: {a: /a.data}\nreward: a\n')
    start('sampler_node', robot_file=path, use_sim_time=True)
    clock = robot.node.create_publisher(Clock, '/clock', 10)
    Topics(robot, a=1.0)

    def run(begin):
        """Let the clock run by 50 ms again and again until ticks come; return their times in ms."""
        robot.selected.clear()
        passed = 0

        def go_on():
            nonlocal passed
            passed += 50
            clock.publish(Clock(clock=conversions.stamp_from_nanoseconds((begin + passed) * 10**6)))
            return len(ticks()) > 3

        def ticks():  # Those of the run before may still be on their way.
            stamps = [conversions.stamp_to_nanoseconds(m.header.stamp) for m in robot.selected]
            return [stamp // 10**6 for stamp in stamps if stamp <= (begin + passed) * 10**6]

        robot.until(go_on)
        return ticks()

    for begin in (50_000, 10_000):
        ticks = run(begin)
        assert all(tick % 100 == 0 and tick >= begin for tick in ticks)
        assert ticks == sorted(set(ticks))
