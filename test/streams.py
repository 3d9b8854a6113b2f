# SPDX-License-Identifier: Apache-2.0

"""Random streams of a robot's topics, and the orders in which they arrive somewhere."""

from collections import Counter
from random import Random
from types import SimpleNamespace as Message
from typing import NamedTuple

from hypothesis import strategies as st

from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.sampler import Sampler

STATUS = '/go/_action/status'
STAMPED, HEADERLESS = ('/odom', '/scan', '/pay', '/turn'), ('/radio', '/goal', STATUS)
MS = 1_000_000
#: All times are in ms from here on.
BEGIN = 5_000_000
END = 8000
#: When the clock is set back, and by how much; nothing is sent in the while before it.
CLOCK_SET, SET_BACK, PAUSE = 4000, 1_000_000, 600
#: Of a message with a stamp.
MAX_DELAY = 300

FILE = """
step: %s
channels:
  x: /odom.data
  scan: {path: "/scan.data[0:2]", max_age: 0.4}
  radio: {path: /radio.data, max_age: 0.5}
  paid: {path: /pay.data, over: [mean, count], max_age: 2.0}
actions:
  turn: {path: /turn.data, max_age: 0.5}
  drive: {path: /turn.data, over: mean, max_age: 0.5}
values:
  distance: {path: /goal.data, max_age: .inf}
  ray: "/scan.data[0]"
reward: %s
episode: {action: /go, terminated: "distance < 0.1", steps: 7}
"""
ROBOTS = [
    parse_robot_file(FILE % (clock, reward))
    for clock in ('{rate: 10}', '{topic: /odom}')
    for reward in ('/pay.data', '"before(distance) - distance + succeeded + x * max(ray, 0)"')
]


class Sent(NamedTuple):
    """A message: when it was sent, its stamp (None: it has none), and its fields."""

    time: int
    stamp: int | None
    fields: dict


@st.composite
def streams(draw, is_set_back=None):
    """Return by topic what is sent.

    The topics have rates of their own, jitter, equal stamps, missing messages, stamps that are far
    away or too old, and publishers that begin anew with a stamp before their last; and the
    clock may be set back.
    """
    random = Random(draw(st.integers(0, 2**32)))
    if is_set_back is None:
        is_set_back = draw(st.booleans())
    return {topic: _stream(draw, topic, random, is_set_back) for topic in STAMPED + HEADERLESS}


def _stream(draw, topic, random, is_set_back):
    is_clock = topic == '/odom'
    period = 100 if is_clock else 100 * draw(st.integers(1, 3))
    missing = 0.02 if is_clock else draw(st.sampled_from([0.0, 0.1, 0.4]))
    # No step may lie between two times at which a message without a stamp may arrive.
    jitter = 0 if is_clock else draw(st.sampled_from([0, 10, 40]))
    restart = END if is_clock else draw(st.sampled_from([END, 2000, 6000]))
    sent, last, was_odd, was_set = [], None, False, False
    for number, time in enumerate(range(1000, END, period)):
        shift = SET_BACK if is_set_back and time >= CLOCK_SET else 0
        rests = restart <= time < restart + 700
        if rests or random.random() < missing or -PAUSE <= time - CLOCK_SET < 0:
            continue
        fields = _fields(topic, number, random)
        if topic in HEADERLESS:
            sent.append(Sent(time + 10 + random.randint(0, 30) - shift, None, fields))
            continue
        stamp = time + 10 * round(random.randint(-jitter, jitter) / 10) - shift
        if time >= CLOCK_SET and is_set_back and not was_set:
            last, was_set = None, True
        is_second = restart <= time < restart + 700 + period or random.random() < 0.1
        may_be_odd = 2500 < time < CLOCK_SET or time > 6500
        if is_second and last is not None:
            stamp = last - 10  # Of a publisher that does not know of the first.
            last = last if is_clock else stamp
        elif may_be_odd and not was_odd and random.random() < 0.1:
            was_odd = True
            stamp += random.choice([-1700, 900_000, -900_000])
        else:
            was_odd, last = False, stamp
        sent.append(Sent(time + 50 - shift, stamp, fields))
    return sent


def _fields(topic, number, random):
    if topic == STATUS:
        code = random.choice([2, 2, 2, 4, 5, 6])
        return {'goal': number // 4, 'status': code}
    if topic == '/scan':
        return {'data': [random.gauss(0, 1) for _ in range(random.choice([2] * 9 + [1]))]}
    is_gap = topic == '/odom' and random.random() < 0.05
    return {'data': float('nan') if is_gap else random.random()}


def arrivals(sent, topics, random):
    """Return (time in ns, topic, Sent) in the order of arrival; a topic's own order is kept.

    What has no stamp arrives soon enough that no step lies between: the time of arrival is its
    time, and for it alone that differs from node to bag.
    """
    arrived = []
    for topic, messages in ((t, sent[t]) for t in topics):
        longest = 40 if topic in HEADERLESS else random.randint(0, MAX_DELAY)
        time, shift = 0, 0
        for message in messages:
            if message.time < time - SET_BACK // 2:  # The clock was set back.
                shift = SET_BACK
            time = max(time, message.time + shift + random.randint(0, longest))
            arrived.append((time, shift, topic, message))
    arrived.sort(key=lambda entry: entry[0])
    return [((BEGIN + t - shift) * MS, topic, m) for t, shift, topic, m in arrived]


def as_message(topic, sent):
    """Return an object with a message's attributes."""
    fields = sent.fields
    if topic == STATUS:
        goal = Message(goal_id=Message(uuid=[fields['goal']] * 16))
        fields = {'status_list': [Message(status=fields['status'], goal_info=goal)]}
    if sent.stamp is not None:
        seconds, rest = divmod(BEGIN + sent.stamp, 1000)
        fields = fields | {'header': Message(stamp=Message(sec=seconds, nanosec=rest * MS))}
    return Message(**fields)


class Run(NamedTuple):
    """What a sampler makes of messages; `late` has the ids of those that came too late."""

    steps: list
    episodes: list
    missing: Counter
    wrong: int
    received: int
    late: set


def collected(robot, arrived, max_lateness=5.0):
    """Return what a sampler makes of what arrives, by the way that the node's steps take."""
    sampler, assembler = Sampler(robot, max_lateness), EpisodeAssembler(1000)
    steps, episodes, late = [], [], set()
    for received, topic, sent in arrived:
        before = sampler.late.total()
        steps += sampler.add(topic, as_message(topic, sent), received)
        if sampler.late.total() > before:
            late.add(id(sent))
    steps += sampler.flush()
    for step in steps:
        episodes += assembler.add_state(step.stamp, list(robot.channel_names), step.state)
        episodes += assembler.actions.add_action(step.stamp, robot.action_names, step.action)
        episodes += assembler.add_reward(step.stamp, step.sample)
    contents = [(e.states.tobytes(), e.rewards.tobytes(), e.actions.tobytes()) for e in episodes]
    return Run(
        steps, contents, sampler.missing.counts, sampler.wrong.total(), sampler.received.total(),
        late,
    )  # fmt: skip
