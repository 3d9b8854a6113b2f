# SPDX-License-Identifier: Apache-2.0

"""The sampler: event time, gaps, ends, and that the order of arrival does not matter."""

from types import SimpleNamespace as Message

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.message_reader import event_time
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.sampler import Sampler

FILE = """
step: {topic: /a}
channels: {a: /a.data, b: {path: /b.data, max_age: 0.25}}
reward: "a - before(a)"
episode: {%s}
"""
MS = SECOND // 1000


def steps_of(episode, messages, lateness=0.5):
    """Return the steps of (topic, milliseconds, value) and the sampler."""
    sampler, steps = Sampler(parse_robot_file(FILE % episode), lateness), []
    for topic, time, value in messages:
        steps += sampler.add(topic, Message(data=value), time * MS)
    return steps + sampler.flush(), sampler


def test_a_message_at_exactly_the_steps_time_belongs_to_it():
    steps, _ = steps_of('steps: 9', [('/a', 0, 1), ('/b', 0, 5), ('/a', 100, 3), ('/b', 100, 6),
                                     ('/a', 200, 4)])  # fmt: skip
    assert [(s.stamp, list(s.state), s.sample.reward) for s in steps] == [
        (0, [1, 5], 2),
        (100 * MS, [3, 6], 1),
    ]


def test_no_step_before_every_topic_has_spoken_and_none_with_an_old_value():
    messages = [('/a', 100 * t, t) for t in range(10)] + [('/b', 250, 7)]
    steps, sampler = steps_of('steps: 99', messages, lateness=5)
    assert [s.stamp // MS for s in steps] == [300, 400, 500]
    assert sampler.missing.in_words(sampler.missing.counts) == {
        'b: no message yet': 3,
        'b: silent for more than its max_age, 0.25 s': 4,
    }


def test_windows_are_truncated_and_an_open_end_is_not_an_episode():
    messages = [(topic, 100 * t, t) for t in range(10) for topic in ('/a', '/b')]
    steps, _ = steps_of('steps: 3', messages)
    assert [s.sample.truncated for s in steps] == [False, False, True] * 2 + [False]
    assert len(episodes_of(steps)) == 2


def test_terminated_by_an_expression():
    messages = [(topic, 100 * t, t) for t in range(10) for topic in ('/a', '/b')]
    steps, _ = steps_of('terminated: a == 4', messages)
    assert [s.sample.terminated for s in steps].index(True) == 3


TASKS = """
step: {topic: /used}
channels: {used: /used.data}
values: {status: /status.data}
reward: used - before(used)
episode: {terminated: "%s"}
"""


def test_a_text_ends_episodes_and_enters_the_reward():
    text = (TASKS % "status == 'done' or status == 'failed'").replace(
        'reward: used - before(used)', "reward: 10 * (status == 'done') - 1"
    )
    sampler, steps = Sampler(parse_robot_file(text)), []
    said = ['going', 'going', 'done', 'going', 'going', 'failed', 'going']
    for i, word in enumerate(said):
        for topic, value in (('/status', word), ('/used', i)):
            steps += sampler.add(topic, Message(data=value), i * SECOND // 2)
    steps += sampler.flush()
    assert [(s.sample.reward, s.sample.terminated) for s in steps] == [
        (-1, False), (9, True), (-1, False), (-1, True),
    ]  # fmt: skip
    assert not sampler.wrong


def both(*parts):
    return False if False in parts else None if None in parts else True


def has_said(said, i, number):
    return None if i < 0 or said[i] is None else said[i] == number


def by_path(said, i, step):
    """Hold until the field is 0 again; one that never is 0 tells of single moments."""
    is_now = bool(said[i])
    spoken = [value for value in said[: i + 1] if value is not None]
    holds = 0 in spoken and spoken[-1] != 0
    return is_now or (not step and holds)


#: By rule, whether an end is so at moment i, None if unknown: `step` is 0 where none is open.
RULES = {
    'status == 2': lambda said, i, step: has_said(said, i, 2),
    'status == 2 and before(status) == 1': lambda said, i, step: both(
        has_said(said, i, 2), has_said(said, i - 1, 1)
    ),
    'step >= 3': lambda said, i, step: step >= 3,
    'before(step) >= 2': lambda said, i, step: step >= 3,
    '/status.data': by_path,
    '/status': lambda said, i, step: said[i] is not None and step > 0,
}


def steps_by_hand(used, said, ends):
    """Return stamp, episode, step, terminated and reward by step; and the moments between."""
    steps, num_between, episode, i, is_over = [], 0, 0, 0, False
    while i < len(used):
        known = ends(said, i, 0)
        is_over = is_over if known is None else known
        if is_over:
            num_between += 1
            i += 1
            continue
        begin = i
        for i in range(begin + 1, len(used)):
            is_over = bool(ends(said, i, i - begin))
            pay = used[i] - used[i - 1]
            steps.append(((i - 1) * 100 * MS, episode, i - 1 - begin, is_over, pay))
            if is_over:
                break
        episode, i = episode + 1, i + 1
    return steps, num_between


@given(
    st.sampled_from(list(RULES)),
    st.lists(st.tuples(st.integers(-9, 9), st.sampled_from([0, 1, 1, 2, 2, 2, None])), min_size=1),
)
def test_what_is_terminal_begins_no_episode(rule, moments):
    sampler, steps = Sampler(parse_robot_file(TASKS % rule)), []
    used, said = zip(*moments, strict=True)
    for i, (number, status) in enumerate(moments):
        unknown = [] if rule.startswith('/') else [float('nan')]
        for value in unknown if status is None else [status]:
            steps += sampler.add('/status', Message(data=value), i * 100 * MS)
        steps += sampler.add('/used', Message(data=number), i * 100 * MS)
    steps += sampler.flush()
    expected, num_between = steps_by_hand(used, said, RULES[rule])
    found = [
        (s.stamp, s.sample.episode, s.sample.step, s.sample.terminated, s.sample.reward)
        for s in steps
    ]
    assert found == expected
    assert sampler.num_between == num_between


def test_a_robot_that_is_idle_after_its_task_is_paid_once_for_it():
    """Status 1: at work; 2: done, and it stays so until the next task."""
    file = TASKS.replace('used - before(used)', '"used - before(used) + 10 * (status == 2)"')
    sampler, steps = Sampler(parse_robot_file(file % 'status >= 2')), []
    for i in range(200):
        status = 1 if i % 20 < 12 else 2
        steps += sampler.add('/status', Message(data=status), i * 100 * MS)
        steps += sampler.add('/used', Message(data=i), i * 100 * MS)
    steps += sampler.flush()
    ends = [step for step in steps if step.sample.terminated]
    assert [step.sample.reward for step in ends] == [11] * 10
    assert {step.sample.step for step in ends} == {11}
    assert sampler.num_between == 10 * 7


def test_a_far_stamp_is_left_out_and_a_clock_set_back_begins_anew():
    first = [(topic, 10**6 + 100 * t, t) for t in range(5) for topic in ('/a', '/b')]
    far = [('/b', 10**9, 0)]
    again = [(topic, 100 * t, t) for t in range(5) for topic in ('/a', '/b')]
    steps, sampler = steps_of('steps: 2', first + far + first[-2:] + again)
    assert sampler.wrong == {'/b': 1, '/a': 0}
    assert [s.stamp // MS for s in steps] == [10**6, 10**6 + 100, 10**6 + 300, 0, 100, 300]


STAMPED = """
step: {topic: /a}
channels: {a: /a.data, b: /b.data}
values: {c: /c.data}
reward: a
"""
HOUR = 3_600_000


def steps_of_stamped(messages):
    """Return stamps and states by (milliseconds, topic, by how much its stamp is off)."""
    sampler, steps = Sampler(parse_robot_file(STAMPED)), []
    for time, topic, shift in sorted(messages):
        seconds, rest = divmod(2 * HOUR + time + shift, 1000)
        header = Message(stamp=Message(sec=seconds, nanosec=rest * MS))
        steps += sampler.add(topic, Message(data=time, header=header), time * MS)
    steps += sampler.flush()
    return [(step.stamp, list(step.state)) for step in steps], +sampler.wrong


@st.composite
def three_topics(draw):
    """Return milliseconds and topic; each has a period of its own."""
    return [
        (time, topic)
        for topic in ('/a', '/b', '/c')
        for time in range(draw(st.integers(0, 500)), 9000, draw(st.sampled_from([10, 300, 1500])))
    ]


@settings(max_examples=50)
@given(three_topics(), st.sampled_from([-HOUR, HOUR]))
def test_one_topic_with_another_clock_disturbs_no_other(messages, off):
    good = [(time, topic, 0) for time, topic in messages if topic != '/c']
    odd = [(time, topic, off) for time, topic in messages if topic == '/c']
    steps, wrong = steps_of_stamped(good + odd)
    assert steps == steps_of_stamped(good)[0]
    assert wrong.keys() == {'/c'}
    # Of the first that ever come, nobody can tell whether they are odd.
    assert wrong['/c'] == len(odd) or min(odd) < min(good)


@settings(max_examples=50)
@given(three_topics(), st.sampled_from([-HOUR, HOUR]), st.integers(1000, 5000))
def test_a_clock_that_is_set_begins_anew_and_nothing_is_wrong(messages, off, when):
    before = [(time, topic, 0) for time, topic in messages if time < when]
    after = [(time, topic, off) for time, topic in messages if time >= when]
    parts = steps_of_stamped(before)[0] + steps_of_stamped(after)[0]
    assert steps_of_stamped(before + after) == (parts, {})


def test_a_topic_that_alone_goes_on_after_the_clock_was_set_is_believed_after_seconds():
    before = [(time, topic, 0) for time in range(0, 3000, 100) for topic in ('/a', '/b', '/c')]
    after = [(time, '/b', HOUR) for time in range(3000, 9000, 100)]
    assert not steps_of_stamped(before + after)[1]


def test_arrays_that_change_their_length_are_gaps():
    robot = parse_robot_file('step: {topic: /s}\nchannels: {s: "/s.r[0:3]"}\nreward: "1"\n')
    sampler = Sampler(robot)
    for time, length in enumerate([3, 3, 2, 3]):
        sampler.add('/s', Message(r=np.ones(length)), time * SECOND * 2)
    sampler.flush()
    assert sampler.wrong['/s'] == 1
    assert sampler.missing.in_words(sampler.missing.counts) == {
        's: its messages come every 2 s, max_age is 1 s': 1
    }


def test_a_message_of_other_things_is_not_wrong_and_changes_nothing():
    robot = parse_robot_file(
        'step: {topic: /d}\nchannels: {x: "/d.status{me}.values{t}.value"}\nreward: x\n'
    )
    sampler, steps = Sampler(robot), []
    for time, (name, text) in enumerate([('me', '1.5'), ('you', '7'), ('me', '2'), ('me', 'hot')]):
        status = Message(name=name, values=[Message(key='t', value=text)])
        steps += sampler.add('/d', Message(status=[status]), time * SECOND // 2)
    steps += sampler.flush()
    assert [list(step.state) for step in steps] == [[1.5], [1.5], [2]]
    assert sampler.wrong == {'/d': 1}  # It says 'hot'.


def test_a_kind_that_is_not_listed_is_a_gap_and_told():
    robot = parse_robot_file(
        'step: {topic: /k}\nchannels: {k: {path: /k.data, one_hot: [0, 2]}}\nreward: "1"\n'
    )
    sampler, steps = Sampler(robot), []
    for t, kind in enumerate([0, 2, 7, 2, 0]):
        steps += sampler.add('/k', Message(data=kind), t * 100 * MS)
    steps += sampler.flush()
    assert [list(step.state) for step in steps] == [[1, 0], [0, 1], [0, 1]]
    assert sampler.missing.in_words(sampler.missing.counts) == {
        'k: its category is not listed in one_hot': 1
    }
    assert sampler.wrong == {'/k': 1}
    assert sampler.last_wrong['/k'] == "/k.data is '7'; expected one of 0, 2 (one_hot)"


def test_who_is_behind_with_receiving_calls_nothing_late():
    """What waits in a queue for 1.5 s keeps its stamp; what has none gets a later time."""
    sampler, steps = Sampler(parse_robot_file(FILE.replace('0.25', '9') % 'steps: 99')), []
    for t in range(40):
        steps += sampler.add('/b', Message(data=t), (100 * t + 2500) * MS)
        stamp = Message(sec=1 + t // 10, nanosec=t % 10 * 100 * MS)
        message = Message(data=t, header=Message(stamp=stamp))
        steps += sampler.add('/a', message, (100 * t + 2500) * MS)
    steps += sampler.flush()
    assert not sampler.late
    assert [s.stamp // MS for s in steps] == list(range(2500, 4900, 100))


def test_event_time():
    header = Message(stamp=Message(sec=2, nanosec=3))
    assert event_time(Message(header=header)) == 2 * SECOND + 3
    assert event_time(Message(header=Message(stamp=Message(sec=0, nanosec=0)))) is None
    assert event_time(Message(data=1)) is None


def goals(*entries):
    return Message(status_list=[
        Message(status=status, goal_info=Message(goal_id=Message(uuid=[goal] * 16)))
        for goal, status in entries
    ])  # fmt: skip


def test_an_episode_is_a_goal():
    sampler, steps = Sampler(parse_robot_file(FILE % 'action: /go')), []
    status = {2: goals((1, 2)), 5: goals((1, 4)), 6: goals((1, 4), (2, 2)), 9: goals((2, 5))}
    for t in range(12):
        if t in status:
            steps += sampler.add('/go/_action/status', status[t], t * 100 * MS)
        steps += sampler.add('/a', Message(data=t), t * 100 * MS)
        steps += sampler.add('/b', Message(data=t), t * 100 * MS)
    steps += sampler.flush()
    assert [(s.stamp // (100 * MS), s.sample.terminated, s.sample.truncated) for s in steps] == [
        (2, False, False), (3, False, False), (4, True, False),
        (6, False, False), (7, False, False), (8, False, True),
    ]  # fmt: skip


def episodes_of(steps):
    assembler, episodes = EpisodeAssembler(1000), []
    for step in steps:
        episodes += assembler.add_state(step.stamp, ['a', 'b'], step.state)
        episodes += assembler.add_reward(step.stamp, step.sample)
    return episodes


@given(
    st.lists(
        st.tuples(st.sampled_from(['/a', '/b']), st.integers(0, 40), st.floats(-9, 9)),
        min_size=1, max_size=60,
    ),
    st.lists(st.integers(0, 400), min_size=60, max_size=60),
)  # fmt: skip
def test_the_order_of_arrival_does_not_matter_within_the_lateness(messages, delays):
    """Live messages come late by different topics; those of a bag are in the order of time."""
    messages = sorted(((t, 50 * time, v) for t, time, v in messages), key=lambda m: m[1])
    delay = dict(zip(('/a', '/b'), delays, strict=False))
    arrived = sorted(messages, key=lambda m: m[1] + delay[m[0]])
    (bag, _), (live, sampler) = steps_of('steps: 4', messages), steps_of('steps: 4', arrived)
    assert not sampler.late
    assert bag == live
    for one, other in zip(episodes_of(bag), episodes_of(live), strict=True):
        assert one.states.tobytes() == other.states.tobytes()
        assert one.rewards.tobytes() == other.rewards.tobytes()


def test_a_reward_without_a_value_is_a_gap_by_its_cause():
    sampler, steps = Sampler(parse_robot_file(FILE.replace('a - before(a)', '1 / a') % '')), []
    for t, value in enumerate([1, 2, 0, 4]):
        for topic in ('/a', '/b'):
            steps += sampler.add(topic, Message(data=value), t * 100 * MS)
    steps += sampler.flush()
    assert [s.sample.reward for s in steps] == [0.5, 0.25]
    assert sampler.missing.in_words(sampler.missing.counts) == {'reward: it has no value': 1}


def test_step_and_its_like_have_a_value_before_the_first_step():
    sampler, steps = (
        Sampler(parse_robot_file(FILE.replace('a - before(a)', 'before(step)') % '')),
        [],
    )
    for t in range(4):
        for topic in ('/a', '/b'):
            steps += sampler.add(topic, Message(data=t), t * 100 * MS)
    steps += sampler.flush()
    assert [s.sample.reward for s in steps] == [0, 1, 2]


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(['data', 'q', 'w', 'x', 'y', 'z', 'r', 'm', 'name', 'status_list']),
            inner,
        ).map(lambda fields: Message(**fields))
    ),
    max_leaves=12,
)


@given(st.lists(st.tuples(st.sampled_from(['/a', '/go/_action/status']), junk), max_size=20))
def test_no_message_of_whatever_kind_ends_it(messages):
    robot = parse_robot_file(
        'step: {topic: /a}\nreward: /a.data\nepisode: {action: /go, terminated: /a.data}\n'
        'channels:\n  a: /a.data\n  yaw: {path: /a.q, as: yaw}\n'
        '  s: {path: "/a.r[0:2]", inf: m}\n  n: "/a.r{x,y}"\n'
    )
    sampler = Sampler(robot)
    for time, (topic, message) in enumerate(messages):
        for step in sampler.add(topic, message, time * MS):
            assert all(map(np.isfinite, step.state))
    sampler.flush()


def test_a_misspelt_name_in_an_array_of_messages_is_told():
    sampler = Sampler(
        parse_robot_file(
            'step: {topic: /a}\n'
            'channels: {a: /a.data, heat: "/d.status{motor}.values{heta}.value"}\n'
            'reward: a\nepisode: {steps: 3}\n'
        ),
        None,
    )
    values = [Message(key='heat', value='40')]
    for second in range(9):
        sampler.add('/a', Message(data=1.0), second * SECOND)
        motor = Message(name='motor', values=values)
        sampler.add('/d', Message(status=[motor]), second * SECOND)
    sampler.flush()
    (said,) = sampler.missing.in_words(sampler.missing.counts)
    assert said == 'heat: no message has a usable value at /d.status{motor}.values{heta}.value'
    assert not sampler.wrong
