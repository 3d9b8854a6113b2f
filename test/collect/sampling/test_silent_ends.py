# SPDX-License-Identifier: Apache-2.0

"""Episodes that end while a topic is silent, and ends that are told before all fall silent."""

from itertools import pairwise
from math import nan
from types import SimpleNamespace as Message

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from selections import selection, sensor

from cmifs_ros.collect.episodes.builder import EpisodeBuilder
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.sampler import Sampler

FILE = """
step: {rate: 10}
channels: {slope: /slope.data, near: /range.near, far: /range.far}
values: {hit: /hit.data, home: /home.data, cost: /cost.data}
reward: "1 - cost - 10 * hit"
episode: {terminated: hit, truncated: home%s}
"""
LENGTH = 12


def run(num_silent, *, silent=('range',), ends='hit', back=0, cost=0.5, far=2.0, more=''):
    """Return episodes and the sampler of three, of which the second's last steps lack something.

    Each has 12 moments, and is told to end at the last.
    """
    sampler, builder = Sampler(parse_robot_file(FILE % more), None), EpisodeBuilder(1000)
    steps = []
    for i in range(3 * LENGTH):
        episode, step = divmod(i, LENGTH)
        is_silent = episode == 1 and LENGTH - num_silent <= step + back < LENGTH
        is_last = step == LENGTH - 1
        messages = {
            'slope': Message(data=nan if is_silent and 'slope' in silent else 0.1 * i),
            'range': Message(
                near=nan if is_silent and 'range' in silent else 1.0 * i,
                far=far if is_silent else 2.0,
            ),
            'hit': Message(data=is_last and ends == 'hit'),
            'home': Message(data=is_last and ends == 'home'),
            'cost': Message(data=cost if is_silent else 0.5),
        }
        for topic, message in messages.items():
            steps += sampler.add(f'/{topic}', message, i * SECOND // 10)
    steps += sampler.flush()
    return [e for step in steps for e in builder.add(step.state, step.sample, step.stamp)], sampler


@pytest.mark.parametrize(('num_silent', 'num_whole'), [(1, 3), (4, 2)])
def test_before_topics_are_switched_off_a_shortened_episode_does_not_count_as_complete(
    num_silent, num_whole
):
    _, sampler = run(num_silent, more='}\nsaving: {after: 1, explore_every: 9, explore_episodes: 9')
    sampler.saving.select(
        selection(
            sensor('slope', is_selected=True, pvalue=0.01, status='confirmed'),
            *(sensor(name, pvalue=0.9, status='dispensable') for name in ('near', 'far')),
            number=1,
        )
    )
    assert sampler.saving.in_words() == (f'all topics are on: {num_whole} of 9 complete episodes')


WHOLE = [0.5] * (LENGTH - 2) + [-9.5]


@pytest.mark.parametrize('num_silent', [1, 2, 4])
def test_an_episode_is_kept_up_to_where_a_topic_fell_silent_with_all_that_it_was_paid(num_silent):
    episodes, sampler = run(num_silent)
    assert len(episodes) == 3
    first, second, third = (episode.rewards.tolist() for episode in episodes)
    assert first == third == WHOLE
    assert second == [0.5] * (LENGTH - num_silent - 1) + [sum(WHOLE[LENGTH - num_silent - 1 :])]
    assert episodes[1].states[:, 0] == pytest.approx(
        [0.1 * i for i in range(LENGTH, 2 * LENGTH - num_silent)]
    )
    # Of a single moment, which the last step reaches, nothing is lacking.
    said = 'they lack near; their rewards count at the last complete step '
    said += '(of 3 that ended this way)'
    assert sampler.ends.dropped_in_words() == (
        {f'last steps of episodes that ended by `terminated`: {said}': 1} if num_silent > 1 else {}
    )
    assert not sampler.ends.problem()


@pytest.mark.parametrize(
    ('what', 'lacks'),
    [
        ({'num_silent': 4, 'silent': ('range', 'slope')}, 'near, slope'),
        ({'num_silent': 8}, 'near'),
        ({'num_silent': 4, 'back': 3}, 'near'),
        ({'num_silent': 4, 'cost': nan}, 'near, reward'),
        ({'num_silent': 12}, 'near'),
        ({'num_silent': 12, 'far': nan}, '2 channels of /range'),
        ({'num_silent': 4, 'ends': 'steps', 'more': ', steps: 11'}, 'near'),
    ],
    ids=[
        'two topics',
        'too long',
        'it comes back',
        'reward unknown',
        'all along',
        'all of it',
        'windows',
    ],
)
def test_else_it_is_lost_and_told_by_its_end(what, lacks):
    episodes, sampler = run(**what)
    assert [episode.rewards.tolist()[:-1] for episode in episodes] == [WHOLE[:-1]] * 2
    kind = 'steps' if what.get('ends') else 'terminated'
    assert sampler.ends.dropped_in_words() == {
        f'episodes that ended by `{kind}`: a step lacks {lacks}; 2 of 3 are left': 1
    }


GOALS = """
step: {%s}
channels: {a: /a.data}
reward: a + 10 * succeeded
episode: {action: /go}
"""


def status(goal, code):
    entry = Message(status=code, goal_info=Message(goal_id=Message(uuid=[goal] * 16)))
    return Message(status_list=[entry])


def goals(step, gap, max_lateness=5.0, flush=False):
    """Return the last steps of four goals; a robot that says nothing between them, in ms."""
    sampler, steps, time = Sampler(parse_robot_file(GOALS % step), max_lateness), [], 0
    for goal in range(4):
        steps += sampler.add('/go/_action/status', status(goal, 2), time * SECOND // 1000)
        for _ in range(10):
            steps += sampler.add('/a', Message(data=1.0), (time + 20) * SECOND // 1000)
            time += 50
        steps += sampler.add('/go/_action/status', status(goal, 4), time * SECOND // 1000)
        time += gap
        if flush:  # As the node does when nothing has come for two seconds.
            steps += sampler.flush()
    steps += sampler.flush()
    assert all(a.stamp < b.stamp for a, b in pairwise(steps))
    return [(s.stamp, s.sample) for s in steps if s.sample.terminated], steps


@pytest.mark.parametrize('step', ['rate: 10', 'topic: /a'])
@pytest.mark.parametrize('gap', [50, 400, 5000])
def test_each_goal_of_a_robot_that_falls_silent_with_it_has_its_end(step, gap):
    ends, steps = goals(step, gap)
    assert [sample.reward for _, sample in ends] == [11.0] * 4
    assert goals(step, gap, None)[1] == steps
    if gap > 2000:
        assert goals(step, gap, flush=True)[1] == steps


HITS = """
step: {%s}
channels: {a: /a.data, taps: {path: /a.data, over: count}}
actions: {push: /push.data, force: {path: /push.data, over: mean}}
values: {hit: {path: /hit.data, max_age: .inf}}
reward: a + 10 * hit
episode: {%s}
"""


def hits(step, ends, gap, max_lateness=5.0, flush=False):
    """Return the steps of four episodes, each of which ends by a hit before a silence, in ms."""
    sampler, steps, time = Sampler(parse_robot_file(HITS % (step, ends)), max_lateness), [], 0

    def say(topic, value, after=0):
        nonlocal steps
        steps += sampler.add(topic, Message(data=value), (time + after) * SECOND // 1000)

    for _ in range(4):
        for i in range(10):
            say('/a', float(i))
            say('/hit', False, 10)
            say('/push', 3.0 + i, 20)
            time += 50
        say('/hit', True, -20)
        if flush:  # As the node does when nothing has come for two seconds, each second.
            steps += sampler.flush()
            steps += sampler.flush()
        time += gap
    steps += sampler.flush()
    return steps


@pytest.mark.parametrize('ends', ['terminated: hit', 'terminated: hit and not before(hit)',
                                  'terminated: hit and force > 0 and push > 11'])  # fmt: skip
@pytest.mark.parametrize('gap', [50, 400, 5000])
@pytest.mark.parametrize('step', ['rate: 20', 'topic: /a'])
def test_each_end_that_an_expression_finds_before_a_silence_counts(step, ends, gap):
    steps = hits(step, ends, gap)
    assert [s.sample.reward >= 10 for s in steps if s.sample.terminated] == [True] * 4
    assert hits(step, ends, gap, None) == steps
    if gap > 2000:
        assert hits(step, ends, gap, flush=True) == steps
    if step == 'topic: /a':
        # Nothing that the last step looked at has started over before.
        assert {s.state[1] for s in steps} == {1.0}


@pytest.mark.parametrize('ends', ['step >= 12', 'a == before(a)', 'taps == 0'])
def test_a_condition_that_no_message_made_true_needs_its_step(ends):
    steps = hits('topic: /a', f"truncated: '{ends}'", 5000)
    assert [s.sample.step for s in steps if s.sample.truncated] == (
        [11, 11, 11] if ends == 'step >= 12' else []
    )


SENT = st.tuples(
    st.sampled_from([10, 10, 10, 50, 400, 1500, 2500, 4500]),
    st.sampled_from(['/a', '/a', '/a', '/hit', '/push']),
    st.sampled_from([0.0, 0.0, 1.0]),
)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(SENT, max_size=60), st.sampled_from(['rate: 20', 'topic: /a']),
    st.sampled_from(['terminated: hit', 'terminated: hit and a == before(a), steps: 5',
                     'truncated: "taps == 0 or push > 0 and force < 1"']),
)  # fmt: skip
def test_a_bag_with_silences_gives_the_steps_of_the_node(sent, step, ends):
    robot = parse_robot_file(HITS % (step, ends))
    live, bag, time = Sampler(robot), Sampler(robot, None), SECOND
    steps, recorded = [], []
    for gap, topic, value in sent:
        for _ in range(2000, gap, 1000):  # The node's reports while all is silent.
            steps += live.flush()
        time += gap * SECOND // 1000
        steps += live.add(topic, Message(data=value), time)
        recorded += bag.add(topic, Message(data=value), time)
    steps += live.flush()
    recorded += bag.flush()
    assert steps == recorded
    assert all(a.stamp <= b.stamp for a, b in pairwise(steps))


def test_what_is_latched_outlives_a_clock_that_is_set_back_and_nothing_else_does():
    robot = parse_robot_file(
        'step: {topic: /a}\nreward: a\n'
        'channels: {a: /a.data, map: {path: /map.data, max_age: .inf}, b: {path: /b.data}}\n'
    )
    sampler, steps = Sampler(robot), []
    for run_ in range(2):
        for time in range(0, 5 * SECOND, SECOND // 10):
            steps += sampler.set_clock(time)
            if not run_ and not time:
                steps += sampler.add('/map', Message(data=7.0), time)
            if not run_ or time >= SECOND:
                steps += sampler.add('/b', Message(data=run_), time)
            steps += sampler.add('/a', Message(data=1.0), time)
    steps += sampler.flush()
    again = [step for step in steps if step.sample.episode]
    assert [step.stamp for step in again] == list(range(SECOND, 49 * SECOND // 10, SECOND // 10))
    assert {tuple(step.state) for step in again} == {(1.0, 7.0, 1.0)}
