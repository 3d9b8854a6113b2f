# SPDX-License-Identifier: Apache-2.0

"""The order of events: how long topics are waited for, and when a clock was set."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.collect.sampling.event_order import EventOrder
from cmifs_ros.collect.sampling.moments import CLOCK_SET, SECOND

MS = SECOND // 1000


def feed(order, arrivals):
    """Return (topic, ms) in order, None where the clock was set, of (ms of arrival, topic, ms)."""
    taken = []
    for received, topic, stamp in sorted(arrivals, key=lambda arrival: arrival[0]):
        taken += order.add(topic, stamp * MS, received * MS, None)
    return in_ms(taken + order.flush())


def in_ms(moments):
    return [
        None if moment is CLOCK_SET else (message.topic, moment.time // MS)
        for moment in moments
        for message in moment.messages or [None]
    ]


def stream(topic, period, end, begin=0, late=0):
    return [(time + late, topic, time) for time in range(begin, end, period)]


def waits(order, arrivals):
    """Return for each message of /fast how much time has passed when it is worked through."""
    found, now = [], 0
    for _, topic, stamp in sorted(arrivals):
        now = max(now, stamp)
        for moment in order.add(topic, stamp * MS, now * MS, None):
            found += [now - moment.time // MS for m in moment.messages if m.topic == '/fast']
    return found


@pytest.mark.parametrize('late', [0, 300, 800, 3000])
def test_a_topic_is_waited_for_as_long_as_its_messages_are_late(late):
    order = EventOrder(['/fast', '/slow'])
    found = waits(order, stream('/fast', 20, 60_000) + stream('/slow', 1000, 60_000, late=late))
    assert late - 20 <= max(found[1000:]) <= 1.5 * late + 120
    assert order.late['/slow'] <= 1 + late // 1000
    assert order.wait_for('/slow') == pytest.approx(1.5 * late / 1000 + 0.1, abs=0.05)


def test_max_lateness_bounds_the_waiting_and_what_is_later_is_counted_by_topic():
    order = EventOrder(['/fast', '/slow'], max_lateness=0.4)
    found = waits(order, stream('/fast', 20, 20_000) + stream('/slow', 1000, 20_000, late=800))
    assert max(found) <= 420
    assert order.late == {'/slow': 20}


def test_two_publishers_of_one_topic_are_sorted_once_they_are_known():
    order = EventOrder(['/fast', '/two'])
    two = [(time + late, '/two', time) for time in range(0, 3000, 50) for late in [time % 100]]
    taken = feed(order, stream('/fast', 20, 3000) + two)
    times = [time for _, time in taken]
    assert times == sorted(times)
    assert order.late.total() <= 1


@given(
    st.sets(st.tuples(st.sampled_from('abc'), st.integers(0, 300))),
    st.tuples(*[st.integers(0, 250)] * 3),
)
def test_recorded_messages_are_sorted_and_none_is_late(sent, delays):
    """Each topic comes later than its stamps by a time of its own, up to 25 s."""
    order, delay = EventOrder('abc', None), dict(zip('abc', delays, strict=True))
    arrivals = sorted((100 * (time + delay[t]), t, 100 * time) for t, time in sent)
    taken = feed(order, arrivals)
    assert taken == [(t, 100 * time) for time, t in sorted((time, t) for t, time in sent)]
    assert not order.late


def runs(count, length, topics, gap=0):
    """Return arrivals of a simulation that begins anew after each run."""
    return [
        (begin + late, topic, time)
        for begin in range(0, count * (length + gap), length + gap)
        for topic, period, delay in topics
        for late, _, time in stream(topic, period, length, late=delay)
    ]


TOPICS = [('/a', 50, 0), ('/b', 100, 30), ('/c', 1000, 10)]


@pytest.mark.parametrize('max_lateness', [5.0, None])
@pytest.mark.parametrize('length', [4000, 15_000, 70_000])
@pytest.mark.parametrize('gap', [0, 3000])
def test_a_clock_that_all_topics_set_back_begins_anew(length, gap, max_lateness):
    order = EventOrder([*(topic for topic, _, _ in TOPICS), '/latched'], max_lateness)
    latched = (1, '/latched', 1)  # It speaks once, at the very beginning.
    taken = feed(order, [latched, *runs(4, length, TOPICS, gap)])
    taken.remove(('/latched', 1))
    one_run = sorted(
        ((topic, time) for topic, period, _ in TOPICS for time in range(0, length, period)),
        key=lambda m: (m[1], m[0]),
    )
    found = [[]]
    for message in taken:
        if message is None:
            found.append([])
        else:
            found[-1].append(message)
    assert found == [one_run] * 4
    assert not +order.late
    assert not +order.wrong


@pytest.mark.parametrize('delay', [0, 50])
def test_the_clock_topic_tells_a_reset_at_once_and_what_is_left_over_is_late(delay):
    order, taken = EventOrder(['/a', '/b']), []
    for run in range(3):
        for time in range(0, 3000, 50):
            taken += order.set_clock(time * MS)
            if run and time == delay:  # One of the run before was still on its way.
                taken += order.add('/b', 2990 * MS, 0, None)
            if time >= delay or not run:
                taken += order.add('/a', time * MS, 0, None)
            if time > delay or not run:
                taken += order.add('/b', time * MS, 0, None)
    taken = in_ms(taken + order.flush())
    assert taken.count(None) == 2
    assert order.late == {'/b': 2}
    second = taken[taken.index(None) + 1 :]
    assert second[: second.index(None)] == [
        (topic, time)
        for time in range(0, 3000, 50)
        for topic in ('/a', '/b')
        if time > delay or (topic == '/a' and time >= delay)
    ]


def test_messages_that_come_before_the_clock_of_their_reset_count_as_after_it():
    order = EventOrder(['/a'])
    taken = order.set_clock(5000 * MS)
    for time in range(5000, 8000, 50):
        taken += order.add('/a', time * MS, 0, None)
    taken += order.add('/a', 100 * MS, 0, None)
    taken += order.set_clock(110 * MS)
    taken += order.add('/a', 150 * MS, 0, None)
    taken = in_ms(taken + order.flush())
    assert taken[-3:] == [None, ('/a', 100), ('/a', 150)]
    assert not +order.late


@pytest.mark.parametrize('seconds', [2, 30, 3000])
def test_one_topic_that_goes_back_alone_is_no_reset(seconds):
    arrivals = stream('/a', 50, 20_000) + stream('/b', 50, 20_000)
    back = [(time, '/c', time - seconds * 1000) for time in range(10_000, 20_000, 50)]
    order = EventOrder(['/a', '/b', '/c'])
    taken = feed(order, arrivals + stream('/c', 50, 10_000) + back)
    assert None not in taken
    assert sum(topic != '/c' for topic, _ in taken) == len(arrivals)


def test_a_clock_by_which_nobody_stamps_resets_nothing():
    order, taken = EventOrder(['/a']), []
    for time in range(0, 9000, 50):
        taken += order.set_clock(time % 3000 * MS)
        taken += order.add('/a', (time + 10**9) * MS, 0, None)
    assert CLOCK_SET not in taken
    assert not order.late


@given(
    st.lists(st.integers(2, 25), min_size=2, max_size=8), st.booleans(), st.booleans(),
    st.sampled_from([0, 20, 70]), st.sampled_from([5.0, None]),
)  # fmt: skip
def test_each_of_many_short_episodes_is_told(lengths, has_clock, has_slow, gap, max_lateness):
    """Three topics at 10 Hz; with /clock, also one that speaks once in an episode."""
    topics = ['/a', '/b', '/c', *(['/slow'] if has_slow and has_clock else [])]
    order, taken, begin = EventOrder(topics, max_lateness), [], 1000
    for length in lengths:
        for time in range(0, length * 100, 100):
            if has_clock:
                taken += order.set_clock((time + 1) * MS)
            for number, topic in enumerate(topics):
                if topic != '/slow' or time == 0:
                    stamp, received = time + 1 + number, begin + time + 10 * number
                    taken += order.add(topic, stamp * MS, received * MS, None)
        begin += length * 100 + gap
    found = [[]]
    for message in in_ms(taken + order.flush()):
        found.append([]) if message is None else found[-1].append(message)
    assert found == [
        [
            (topic, time + 1 + number)
            for time in range(0, length * 100, 100)
            for number, topic in enumerate(topics)
            if topic != '/slow' or time == 0
        ]
        for length in lengths
    ]
    assert not +order.late


@given(st.lists(st.integers(0, 20_000), min_size=50, max_size=50), st.booleans())
def test_one_topic_out_of_order_by_many_seconds_is_no_reset(delays, is_flushed):
    """Its messages come at random, or in queues that arrive at once and out of order."""
    order = EventOrder(['/a', '/b'], None)
    arrivals = stream('/a', 100, 20_000)
    for number, delay in enumerate(delays):
        time = 350 * number + 7
        received = (time // 5000 + 1) * 5000 + delay / 1000 if is_flushed else time + delay
        arrivals.append((received, '/b', time))
    in_order = sorted((time, topic) for _, topic, time in arrivals)
    # What comes after all others had ended may be of another time.
    arrivals += [(time, '/a', time) for time in range(20_000, 45_000, 100)]
    taken = feed(order, [(int(received), topic, time) for received, topic, time in arrivals])
    assert taken[: len(in_order)] == [(topic, time) for time, topic in in_order]
    assert None not in taken
    assert not +order.late


def test_a_clock_that_was_set_back_before_the_topics_go_elsewhere_is_no_error():
    order = EventOrder(['/a'])
    taken = order.set_clock(5000 * MS)
    taken += order.add('/a', 5000 * MS, 0, None)
    taken += order.set_clock(0)
    for time in range(900_000, 901_000, 100):  # Nothing came from the time that /clock tells.
        taken += order.add('/a', time * MS, 0, None)
    taken = in_ms(taken + order.flush())
    assert taken[0] == ('/a', 5000)
    assert [time for time in taken if time][-10:] == [
        ('/a', time) for time in range(900_000, 901_000, 100)
    ]


@given(
    st.lists(
        st.tuples(
            st.integers(-100_000, 100_000) | st.just(0),  # Where the clock is set, in ms.
            st.integers(5, 60),
            st.tuples(*[st.integers(0, 400)] * 3),  # How late each topic is.
        ),
        min_size=1,
        max_size=5,
    ),
    st.sets(st.tuples(st.integers(0, 250), st.integers(-90_000, 90_000)), max_size=4),
    st.booleans(), st.booleans(), st.sampled_from([5.0, None]),
)  # fmt: skip
def test_each_message_is_taken_once_or_counted(runs_, errors, has_clock, is_stamped, max_lateness):
    """Clocks are set anywhere, single stamps are wrong; between settings the order holds."""
    arrivals, begin = [], 1_000_000
    for at, length, lateness in runs_:
        for step in range(0, length * 100, 100):
            time = 200_000 + at + step
            if has_clock:
                arrivals.append((begin + step, None, time))
            for topic, late in zip('abc', lateness, strict=True):
                stamp = time if is_stamped or topic != 'c' else None
                arrivals.append((begin + step + late, topic, stamp))
        begin += length * 100
    for number, error in errors:
        received, topic, time = arrivals[number % len(arrivals)]
        if topic is not None and time is not None:
            arrivals[number % len(arrivals)] = received, topic, time + error
    order, taken, sent = EventOrder('abc', max_lateness), [], 0
    for number, (received, topic, time) in enumerate(sorted(arrivals, key=lambda a: a[0])):
        if topic is None:
            taken += order.set_clock(time * MS)
        else:
            stamp, sent = None if time is None else time * MS, sent + 1
            taken += order.add(topic, stamp, received * MS, number)
    taken += order.flush()
    numbers = [message.content for moment in taken for message in moment.messages]
    assert len(set(numbers)) == len(numbers)
    assert len(numbers) + order.late.total() + order.wrong.total() == sent
    before = -1
    for moment in taken:
        assert moment is CLOCK_SET or moment.time > before
        before = moment.time


@pytest.mark.parametrize(
    ('clock', 'remedy'),
    [(None, 'set use_sim_time'), (1000, 'their stamps are not in the time of /clock')],
)
def test_a_receive_time_far_from_the_stamps_is_unusable_with_a_remedy(clock, remedy):
    order = EventOrder(['/a', '/b'])
    if clock is not None:
        order.set_clock(clock * SECOND)
    for second in range(1000, 1003):
        order.add('/a', (second - 500) * SECOND, second * SECOND, None)
        order.add('/b', None, second * SECOND, None)
    assert order.wrong == {'/b': 3}
    assert remedy in order.last_wrong['/b']
