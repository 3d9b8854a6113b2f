# SPDX-License-Identifier: Apache-2.0

"""What a sampler logs about steps that lack something."""

import math
from types import SimpleNamespace as Message

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from selections import selection, sensor

from cmifs_ros.collect.robot_file import parse_robot_file
from cmifs_ros.collect.sampling.sampler import SECOND, Sampler
from cmifs_ros.ros import sampler_status
from cmifs_ros.ros.sampler_status import SamplerStatus

ROBOT = """
step: {topic: /a}
channels: {a: /a.data, %s}
reward: a
episode: {steps: 10}
"""


SAVING = ROBOT % 'b: /b.data' + 'saving: {after: 1, explore_every: 9, explore_episodes: 1}\n'


@pytest.mark.parametrize(('file', 'is_off'), [(ROBOT % 'b: /b.data', False), (SAVING, True)])
def test_a_robot_that_stands_still_is_stale_also_while_topics_are_switched_off(
    monkeypatch, file, is_off
):
    now = [0.0]
    monkeypatch.setattr(sampler_status.time, 'monotonic', lambda: now[0])
    robot = parse_robot_file(file)
    sampler = Sampler(robot)
    sampler.saving.select(
        selection(
            sensor('a', is_selected=True, pvalue=0.01, status='confirmed'),
            sensor('b', pvalue=0.9, status='dispensable'),
            number=1,
        )
    )
    status = SamplerStatus('sampler', sampler, dict.fromkeys(robot.topics, 1.0))
    levels = []
    for second in range(60):
        now[0] = float(second)
        for topic in '/a', '/b':
            if second < 40 and topic not in sampler.saving.off:
                sampler.add(topic, Message(data=float(second)), second * SECOND)
        levels.append(status.statuses({})[0].level)
    assert (sampler.saving.off == {'/b'}) == is_off
    assert set(levels[5:40]) == {DiagnosticStatus.OK}
    assert set(levels[52:]) == {DiagnosticStatus.STALE}


@pytest.mark.parametrize(('silent', 'num_lines'), [('bcd', 3), ('bcdef', 1)])
def test_what_steps_lack_is_logged_once_and_in_one_line_if_it_is_much(
    monkeypatch, silent, num_lines
):
    now = [0.0]
    monkeypatch.setattr(sampler_status.time, 'monotonic', lambda: now[0])
    robot = parse_robot_file(ROBOT % ', '.join(f'{name}: /{name}.data' for name in silent))
    sampler = Sampler(robot)
    status = SamplerStatus('sampler', sampler, dict.fromkeys(robot.topics, 1.0))
    lines = []
    for second in range(20):
        now[0] = float(second)
        sampler.add('/a', Message(data=1.0), second * SECOND)
        lines += status.news()
    assert len(lines) == num_lines
    said = '; '.join(f'{name}: no message' for name in 'bcd')
    if num_lines == 1:
        assert lines == [f'steps lack {said}; and 2 more, see /diagnostics; this breaks episodes']
    else:
        assert lines == [f'steps lack {name}: no message; this breaks episodes' for name in 'bcd']


def test_losses_that_depend_on_the_end_are_logged_once_and_told_beside_what_steps_lack(
    monkeypatch,
):
    now = [0.0]
    monkeypatch.setattr(sampler_status.time, 'monotonic', lambda: now[0])
    robot = parse_robot_file(
        'step: {topic: /a}\nreward: a\n'
        'channels: {a: /a.data, b: {path: /b.data, max_age: 0.5}, '
        'c: {path: /c.data, max_age: 0.5}}\n'
        'values: {hit: {path: /hit.data, max_age: .inf}, home: {path: /home.data, max_age: .inf}}\n'
        'episode: {terminated: hit, truncated: home}\n'
    )
    sampler = Sampler(robot)
    status = SamplerStatus('sampler', sampler, dict.fromkeys(robot.topics, 1.0))
    lines, messages = [], []
    for second in range(120):
        now[0], place = float(second), second % 10
        has_failed = second // 10 % 2
        ends = {'/hit': has_failed and place == 8, '/home': not has_failed and place == 8}
        is_dark = has_failed and 3 <= place < 9
        said = ends | {'/a': 1.0} | ({} if is_dark else {'/b': 1.0, '/c': 2.0})
        for topic, value in said.items():
            sampler.add(topic, Message(data=float(value)), second * SECOND)
        lines += status.news()
        messages.append(status.statuses({})[0].message)
    told = [line for line in lines if line.startswith('dropped')]
    assert len(told) == 1
    assert 'episodes that ended by `terminated`: a step lacks b, c; none of 3 is left' in told[0]
    both = [message for message in messages if message.startswith('dropped')]
    assert 'none of 6 is left' in both[-1]
    assert any(' lack ' in message for message in both)
    assert any(message.endswith('ended otherwise') for message in both)


def test_of_messages_that_come_too_late_it_says_so(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(sampler_status.time, 'monotonic', lambda: now[0])
    robot = parse_robot_file(ROBOT % 'b: /b.data, c: /c.data')
    sampler = Sampler(robot, max_lateness=0.5)
    status = SamplerStatus('sampler', sampler, dict.fromkeys(robot.topics, 1.0))
    lines = []

    def say(topic, seconds):
        header = Message(stamp=Message(sec=int(seconds), nanosec=0))
        sampler.add(topic, Message(header=header, data=1.0), 0)

    for second in range(100, 120):
        now[0] = float(second)
        say('/a', second)
        say('/b', second - 3)
        say('/c', second if second < 108 else second - 3)  # It has been in time before.
        lines += status.news()
    said = 'its messages come later than steps can wait; this breaks episodes'
    assert lines == [f'steps lack {name}: {said}' for name in 'bc']


def test_a_lag_of_the_node_and_a_clock_that_is_wrong_are_told_apart():
    robot = parse_robot_file(ROBOT % 'b: /b.data, c: /c.data, d: /d.data')
    status = SamplerStatus('sampler', Sampler(robot), dict.fromkeys(robot.topics, 1.0))

    def told(**ages):
        for name, age in ages.items():
            for jitter in 0.0, 0.2:
                status.heard(f'/{name}', age + jitter)
        return {one.name[9:]: (one.level, one.message) for one in status.statuses({})}

    well = told(a=0.0, b=0.0, c=0.9, d=math.inf)
    assert {well[f'/{name}'] for name in 'abcd'} == {(DiagnosticStatus.OK, 'received')}
    found = told(a=0.0, b=2.0, c=-2.2, d=math.inf)
    assert found['steps'] == well['steps']
    assert found['/a'] == found['/d'] == (DiagnosticStatus.OK, 'received')
    assert found['/b'] == (DiagnosticStatus.OK, 'received 2.0 s after its stamps')
    what = 'its stamps are 2.0 s ahead: set the clock of whoever stamps it'
    ahead = DiagnosticStatus.WARN, what
    assert found['/c'] == ahead
    found = told(a=7.9, b=10.1, c=10.5, d=math.inf)
    assert found['/a'] == ahead
    assert found['/b'] == found['/c'] == (DiagnosticStatus.OK, 'received')
    assert found['steps'][1].startswith('messages of most topics are taken 10.1 s after')
    assert told(a=1e9, b=1e9)['steps'] == well['steps']  # Simulated time, on a real clock.
