# SPDX-License-Identifier: Apache-2.0

import itertools
from array import array

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.pairing import MAX_PENDING, EpisodeAssembler

NAMES = ['a', 'b']


def state_of(number):
    """Return a state that tells which transition it belongs to."""
    return array('d', [number, -number])


def sample_of(number, step, length, *, fields=('ends', 'episode', 'step'), episode=0):
    ends = step == length - 1
    return RewardSample(
        reward=float(number),
        terminated=False if 'ends' in fields else None,
        truncated=ends if 'ends' in fields else None,
        episode=episode if 'episode' in fields else None,
        step=step if 'step' in fields else None,
    )


def stream(lengths, fields=('ends', 'episode', 'step'), period=10):
    """Return (stamp, state, sample) of each transition of some episodes."""
    transitions = []
    for episode, length in enumerate(lengths):
        for step in range(length):
            number = len(transitions)
            sample = sample_of(number, step, length, fields=fields, episode=episode)
            transitions.append(((number + 1) * period, state_of(number), sample))
    return transitions


def feed(assembler, transitions):
    episodes = []
    for stamp, state, sample in transitions:
        episodes += assembler.add_state(stamp, NAMES, state)
        episodes += assembler.add_reward(stamp, sample)
    return episodes


def rewards(episodes):
    return [e.rewards.tolist() for e in episodes]


@pytest.mark.parametrize('fields', [('ends', 'episode', 'step'), ('ends',), ('episode', 'step')])
def test_whole_episodes_come_out_as_they_went_in(fields):
    assembler = EpisodeAssembler(100)
    episodes = feed(assembler, stream([3, 1, 2, 1], fields))
    expected = [[0, 1, 2], [3], [4, 5], [6]]
    # Without end marks an episode is known to be over when the next one begins.
    assert rewards(episodes) == (expected if 'ends' in fields else expected[:-1])
    for episode in episodes:
        np.testing.assert_array_equal(episode.states[:, 0], episode.rewards)
        np.testing.assert_array_equal(episode.states[:, 1], -episode.rewards)
    assert not assembler.dropped_messages
    assert not assembler.builder.dropped
    assert assembler.num_transitions == 7


@pytest.mark.parametrize('fields', [('ends', 'episode', 'step'), ('ends',), ('episode', 'step')])
def test_the_stamps_of_episodes_and_the_time_between_steps_are_known(fields):
    assembler = EpisodeAssembler(100)
    assert np.isnan(assembler.builder.step_seconds)
    assembler.builder.stamps = []
    episodes = feed(assembler, stream([3, 1, 2], fields, period=10**8))
    stamps = [s.tolist() for s in assembler.builder.stamps]
    assert stamps == [((e.rewards + 1) * 10**8).tolist() for e in episodes]
    assert assembler.builder.step_seconds == 0.1


def test_without_any_boundaries_episodes_are_closed_at_the_limit():
    assembler = EpisodeAssembler(3)
    assert rewards(feed(assembler, stream([8], fields=()))) == [[0, 1, 2], [3, 4, 5]]
    assert assembler.builder.num_cut == 2


def test_an_episode_that_never_ends_is_cut_and_goes_on_as_a_new_one():
    assembler = EpisodeAssembler(3)
    assert rewards(feed(assembler, stream([7]))) == [[0, 1, 2], [3, 4, 5], [6]]
    assert assembler.builder.num_cut == 2
    assert not assembler.builder.dropped


def lose(transitions, *, states=(), samples=()):
    """Return the messages in order, without those of the given transitions."""
    messages = []
    for number, (stamp, state, sample) in enumerate(transitions):
        if number not in states:
            messages.append(('state', stamp, state))
        if number not in samples:
            messages.append(('reward', stamp, sample))
    return messages


def deliver(assembler, messages):
    episodes = []
    for kind, stamp, content in messages:
        if kind == 'state':
            episodes += assembler.add_state(stamp, NAMES, content)
        else:
            episodes += assembler.add_reward(stamp, content)
    return episodes


@pytest.mark.parametrize(
    ('lost', 'message_cause', 'episode_cause'),
    [
        ({'states': {4}}, 'reward_without_state', 'lost_state'),
        ({'samples': {4}}, 'state_without_reward', 'step_gap'),
        ({'states': {4}, 'samples': {4}}, None, 'step_gap'),
    ],
)
def test_an_episode_with_a_lost_transition_is_dropped_and_counted(
    lost, message_cause, episode_cause
):
    assembler = EpisodeAssembler(100)
    episodes = deliver(assembler, lose(stream([3, 3, 3]), **lost))
    assert rewards(episodes) == [[0, 1, 2], [6, 7, 8]]
    assert assembler.builder.dropped == {episode_cause: 1}
    assert assembler.dropped_messages == ({message_cause: 1} if message_cause else {})
    assert assembler.num_pending == 0
    assert assembler.last_drops.keys() == ({message_cause} if message_cause else set()) | {
        episode_cause
    }


@pytest.mark.parametrize('lost', [{2}, {5}])
def test_a_lost_end_drops_that_episode_alone(lost):
    assembler = EpisodeAssembler(100)
    episodes = deliver(assembler, lose(stream([3, 3, 3]), states=lost, samples=lost))
    kept = [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    del kept[lost.pop() // 3]
    assert rewards(episodes) == kept
    assert assembler.builder.dropped == {'lost_end': 1}


def test_joining_midway_waits_for_the_next_beginning():
    assembler = EpisodeAssembler(100)
    assert rewards(feed(assembler, stream([5, 2])[2:])) == [[5, 6]]
    assert assembler.builder.dropped == {'joined_midway': 1}


def test_channels_are_matched_by_name():
    assembler = EpisodeAssembler(100)
    assembler.add_state(10, ['a', 'b'], array('d', [1, 2]))
    assembler.add_reward(10, sample_of(0, 0, 2))
    assembler.add_state(20, ['b', 'a'], array('d', [4, 3]))
    (episode,) = assembler.add_reward(20, sample_of(1, 1, 2))
    assert episode.states.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ('names', 'values', 'cause'),
    [
        (('a', 'b'), [1.0], 'wrong_length'),
        ((), [], 'wrong_length'),
        ((), [1.0, 2.0], 'wrong_length'),
        (('a', 'c'), [1.0, 2.0], 'wrong_channels'),
        (('a', 'b', 'c'), [1.0, 2.0, 3.0], 'wrong_channels'),
        (('a',), [1.0], 'wrong_channels'),
        (('a', 'a'), [1.0, 2.0], 'wrong_channels'),
        (('a', ''), [1.0, 2.0], 'wrong_channels'),
        (('a', 'b'), [1.0, np.nan], 'not_finite'),
        (('b', 'a'), [np.nan, 1.0], 'not_finite'),
    ],
)
def test_an_unusable_state_is_counted_and_disturbs_only_its_episode(names, values, cause):
    assembler = EpisodeAssembler(100)
    transitions = stream([2, 2, 2])
    episodes = feed(assembler, transitions[:2])
    assembler.add_state(transitions[2][0], list(names), array('d', values))
    assembler.add_reward(transitions[2][0], transitions[2][2])
    episodes += feed(assembler, transitions[3:])
    assert rewards(episodes) == [[0, 1], [4, 5]]
    assert assembler.dropped_messages == {cause: 1, 'reward_without_state': 1}
    assert sum(assembler.builder.dropped.values()) == 1


@given(st.data())
def test_the_part_of_a_state_that_has_the_rewards_stamps_is_the_state_in_whatever_order(data):
    assembler = EpisodeAssembler(100)
    transitions, received = stream([3, 2]), []
    for number, (stamp, state, sample) in enumerate(transitions):
        messages = [
            ('state', stamp, NAMES, state),
            ('state', stamp - 3, ['gripper'], array('d', [number])),
            ('reward', stamp, sample),
        ]
        for kind, *message in data.draw(st.permutations(messages)):
            take = assembler.add_state if kind == 'state' else assembler.add_reward
            received += take(*message)
    assert rewards(received) == [[0, 1, 2], [3, 4]]
    assert assembler.channel_names == tuple(NAMES)
    assert assembler.dropped_messages == {'wrong_channels': 5}


@pytest.mark.parametrize('is_gripper_first', [False, True])
def test_of_parts_with_one_stamp_the_one_of_most_channels_is_the_state(is_gripper_first):
    assembler = EpisodeAssembler(100)
    parts = [(NAMES, state_of(1)), (['gripper'], array('d', [0]))]
    for part in parts[::-1] if is_gripper_first else parts:
        assembler.add_state(10, *part)
    (episode,) = assembler.add_reward(10, sample_of(1, 0, 1))
    assert episode.states.tolist() == [[1, -1]]


def test_before_the_first_reward_states_of_a_few_sets_of_channels_wait():
    assembler = EpisodeAssembler(100)
    for number in range(100):
        assembler.add_state(number, [f'channel {number}'], array('d', [number]))
    assert assembler.num_pending == 100 - assembler.dropped_messages['state_without_reward'] < 10
    assert assembler.channel_names is None
    (episode,) = assembler.add_reward(99, sample_of(0, 0, 1))
    assert episode.states.tolist() == [[99]]


def test_states_in_another_order_of_channels_wait_together_for_the_first_reward():
    assembler = EpisodeAssembler(100)
    assembler.add_state(10, ['a', 'b'], array('d', [1, 2]))
    assembler.add_state(20, ['b', 'a'], array('d', [4, 3]))
    assembler.add_reward(10, sample_of(0, 0, 2))
    (episode,) = assembler.add_reward(20, sample_of(1, 1, 2))
    assert episode.states.tolist() == [[1, 2], [3, 4]]


def test_huge_values_are_finite_though_their_sum_is_not():
    assembler = EpisodeAssembler(100)
    assembler.add_state(1, NAMES, array('d', [1e308, 1e308]))
    (episode,) = assembler.add_reward(1, sample_of(0, 0, 1))
    assert episode.states.tolist() == [[1e308, 1e308]]


def test_a_first_state_with_bad_names_does_not_become_the_norm():
    assembler = EpisodeAssembler(100)
    assembler.add_state(1, ['a', 'a'], array('d', [0, 0]))
    assembler.add_state(2, ['a', 'b'], array('d', [0, np.nan]))
    assert assembler.channel_names is None
    assert rewards(feed(assembler, stream([2]))) == [[0, 1]]


def test_duplicates_are_counted_and_change_nothing():
    assembler = EpisodeAssembler(100)
    messages = [m for m in lose(stream([3, 2])) for _ in range(2)]
    assert rewards(deliver(assembler, messages)) == [[0, 1, 2], [3, 4]]
    assert assembler.dropped_messages == {'duplicate_stamp': 10}
    assert not assembler.builder.dropped


def test_time_running_backwards_begins_anew():
    assembler = EpisodeAssembler(100)
    again = [
        (stamp, state_of(n + 10), sample_of(n + 10, s.step, 3, episode=s.episode))
        for n, (stamp, _, s) in enumerate(stream([3, 3]))
    ]
    episodes = feed(assembler, stream([3, 3])[:5]) + feed(assembler, again)
    assert rewards(episodes) == [[0, 1, 2], [10, 11, 12], [13, 14, 15]]
    assert assembler.builder.dropped == {'time_backwards': 1}


@pytest.mark.parametrize('kind', ['state', 'reward', 'both'])
def test_a_message_sent_again_long_after_changes_nothing(kind):
    assembler = EpisodeAssembler(100)
    transitions = stream([3, 3])
    episodes = feed(assembler, transitions[:5])
    stamp, state, sample = transitions[3]
    if kind in ('state', 'both'):
        assembler.add_state(stamp, NAMES, state)
    if kind in ('reward', 'both'):
        assembler.add_reward(stamp, sample)
    episodes += feed(assembler, transitions[5:])
    assert rewards(episodes) == [[0, 1, 2], [3, 4, 5]]
    assert assembler.dropped_messages == {'duplicate_stamp': 2 if kind == 'both' else 1}
    assert not assembler.builder.dropped


@pytest.mark.parametrize('kind', ['state', 'reward'])
def test_a_lone_message_from_the_past_changes_nothing(kind):
    assembler = EpisodeAssembler(100)
    transitions = stream([3, 3])
    episodes = feed(assembler, transitions[:5])
    if kind == 'state':
        assembler.add_state(5, NAMES, state_of(99))
    else:
        assembler.add_reward(5, sample_of(99, 0, 3))
    episodes += feed(assembler, transitions[5:])
    assert rewards(episodes) == [[0, 1, 2], [3, 4, 5]]
    assert assembler.dropped_messages == {'too_late': 1}
    assert not assembler.builder.dropped


def test_states_that_never_get_a_reward_do_not_starve_those_that_do():
    assembler = EpisodeAssembler(100)
    for stamp in range(10**6, 10**6 + MAX_PENDING):
        assembler.add_state(stamp, NAMES, state_of(0))
    transitions = stream([3, 3, 3])
    episodes = []
    for n, (stamp, state, _) in enumerate(transitions):
        assembler.add_state(stamp, NAMES, state)
        if n >= 2:  # rewards lag two states behind
            episodes += assembler.add_reward(transitions[n - 2][0], transitions[n - 2][2])
    assert rewards(episodes) == [[0, 1, 2], [3, 4, 5]]


def test_streams_may_run_ahead_of_each_other():
    assembler = EpisodeAssembler(100)
    transitions = stream([3, 2])
    for stamp, state, _ in transitions:
        assert assembler.add_state(stamp, NAMES, state) == []
    episodes = []
    for stamp, _, sample in transitions:
        episodes += assembler.add_reward(stamp, sample)
    assert rewards(episodes) == [[0, 1, 2], [3, 4]]


def test_a_stream_may_run_ahead_by_all_that_may_wait():
    assembler = EpisodeAssembler(100)
    transitions = stream([4] * (MAX_PENDING // 4))
    for stamp, state, _ in transitions:
        assembler.add_state(stamp, NAMES, state)
    episodes = []
    for stamp, _, sample in transitions:
        episodes += assembler.add_reward(stamp, sample)
    assert len(episodes) == MAX_PENDING // 4
    assert not assembler.dropped_messages


def test_what_waits_is_bounded():
    assembler = EpisodeAssembler(100)
    for stamp in range(MAX_PENDING + 5):
        assembler.add_state(stamp, NAMES, state_of(0))
    assert assembler.num_pending == MAX_PENDING
    assert assembler.dropped_messages == {'state_without_reward': 5}


def test_fields_may_come_and_go_without_harm():
    assembler = EpisodeAssembler(100)
    episodes = []
    for number in range(20):
        fields = [('step',), ('episode', 'step'), ('ends',), ()][number % 4]
        assembler.add_state(number, NAMES, state_of(number))
        episodes += assembler.add_reward(number, sample_of(number, number % 3, 3, fields=fields))
    assert assembler.num_transitions == 20
    for episode in episodes:  # whatever they are, they are runs of what was sent
        np.testing.assert_array_equal(np.diff(episode.rewards), 1)
        np.testing.assert_array_equal(episode.states[:, 0], episode.rewards)


def test_states_and_rewards_within_the_tolerance_belong_together():
    transitions = stream([3, 2])
    shifts = itertools.cycle([0, 3, -3])
    messages = [
        (kind, stamp if kind == 'state' else stamp + next(shifts), content)
        for kind, stamp, content in lose(transitions)
    ]
    assembler = EpisodeAssembler(100)
    assert deliver(assembler, messages) == []
    assert assembler.nearest_state() == 3
    tolerant = EpisodeAssembler(100)
    tolerant.stamp_tolerance = 3
    assert rewards(deliver(tolerant, messages)) == [[0, 1, 2], [3, 4]]
    assert not tolerant.dropped_messages
    assert tolerant.nearest_state() is None


def test_equal_stamps_are_named_as_such():
    assembler = EpisodeAssembler(100)
    halved = [((n // 2 + 1) * 10, *rest) for n, (_, *rest) in enumerate(stream([4, 4]))]
    assert feed(assembler, halved) == []
    assert set(assembler.builder.dropped) == {'equal_stamps'}
    assert 'the same stamp' in assembler.last_drops['equal_stamps']
    together = EpisodeAssembler(100)
    for number in range(2):
        together.add_state(10, NAMES, state_of(number))
    assert together.dropped_messages == {'equal_stamps': 1}


def test_step_zero_begins_an_episode_where_nothing_tells_of_ends():
    episodes = feed(EpisodeAssembler(100), stream([3, 2, 4], fields=('step',)))
    assert rewards(episodes) == [[0, 1, 2], [3, 4]]
    marked = EpisodeAssembler(100)
    transitions = stream([3, 2, 4], fields=('ends', 'step'))
    assert rewards(feed(marked, transitions[:2] + transitions[3:])) == [[3, 4], [5, 6, 7, 8]]


def test_clear_forgets_channels_and_what_is_open_but_not_the_counts():
    assembler = EpisodeAssembler(100)
    assembler.add_state(1, ['a', ''], array('d', [0, 0]))
    feed(assembler, stream([3])[:2])
    assembler.clear()
    assert assembler.channel_names is None
    assert assembler.num_pending == 0
    assert assembler.dropped_messages == {'wrong_channels': 1}
    assert rewards(feed(assembler, stream([3, 1]))) == [[0, 1, 2], [3]]


@settings(max_examples=300)
@given(data=st.data())
def test_every_episode_that_comes_out_was_sent_complete_and_in_order(data):
    lengths = data.draw(st.lists(st.integers(1, 5), min_size=1, max_size=8))
    transitions = stream(lengths)
    count = len(transitions)
    numbers = st.sets(st.integers(0, count - 1), max_size=4)
    states, samples = data.draw(numbers), data.draw(numbers)
    messages = lose(transitions, states=states, samples=samples)
    for kind in data.draw(st.lists(st.sampled_from(['repeat', 'swap', 'nan']), max_size=4)):
        if len(messages) < 2:
            break
        i = data.draw(st.integers(0, len(messages) - 2))
        if kind == 'repeat':
            messages.insert(i, messages[i])
        elif kind == 'swap':
            messages[i], messages[i + 1] = messages[i + 1], messages[i]
        elif messages[i][0] == 'state':
            messages[i] = ('state', messages[i][1], array('d', [np.nan] * 2))

    assembler = EpisodeAssembler(100)
    episodes = deliver(assembler, messages)
    starts = np.cumsum([0, *lengths])
    sent = [list(range(a, b)) for a, b in itertools.pairwise(starts)]
    received = rewards(episodes)
    assert all(episode in sent for episode in received)
    assert received == sorted(received)
    assert len(received) == len({tuple(episode) for episode in received})
    for episode in episodes:
        np.testing.assert_array_equal(episode.states[:, 0], episode.rewards)
    noticed = assembler.dropped_messages + assembler.builder.dropped
    # A single-step episode that is lost altogether leaves no trace.
    assert received == sent or noticed or assembler.num_pending or states & samples


class Sender:
    """Publishers that are killed and started again, of which time may be set back."""

    def __init__(self):
        self.episodes = []  # the numbers of the transitions of each, and whether it ended
        self.states, self.samples = [], []

    def session(self, begin, lengths, killed_after, first_episode, shuffle):
        """Send episodes from a stamp on; of the last only so many transitions."""
        stamp = begin
        for episode, length in enumerate(lengths, first_episode):
            numbers = []
            is_last = episode == first_episode + len(lengths) - 1
            for step in range(min(length, killed_after) if is_last else length):
                number = len(self.states)
                numbers.append(number)
                names = NAMES if shuffle(number) else NAMES[::-1]
                state = state_of(number) if names == NAMES else state_of(number)[::-1]
                self.states.append((stamp, names, state))
                self.samples.append((stamp, sample_of(number, step, length, episode=episode)))
                stamp += 10
            self.episodes.append((numbers, len(numbers) == length))


def spoil(data, messages, spoiled):
    """Drop, repeat, delay or spoil some messages of a stream."""
    positions = st.integers(0, max(0, len(messages) - 1))
    faults = st.tuples(st.sampled_from(['drop', 'repeat', 'delay', 'spoil']), positions)
    for fault, i in data.draw(st.lists(faults, max_size=5)):
        if i >= len(messages):
            continue
        if fault == 'drop':
            del messages[i]
        elif fault == 'repeat':
            messages.insert(data.draw(st.integers(i, len(messages))), messages[i])
        elif fault == 'delay':
            messages.insert(min(len(messages), i + data.draw(st.integers(1, 3))), messages.pop(i))
        else:
            messages[i] = data.draw(spoiled)(messages[i])


BAD_STATES = st.sampled_from([
    lambda m: (m[0], m[1], array('d', [np.nan, 1])),
    lambda m: (m[0], m[1], array('d', [1])),
    lambda m: (m[0], ['a', ''], m[2]),
    lambda m: (m[0], ['a', 'renamed'], m[2]),
    lambda m: (m[0], [*NAMES, 'new'], array('d', [0] * 3)),
    lambda m: (m[0] + 3, m[1], m[2]),
])  # fmt: skip
BAD_SAMPLES = st.just(lambda m: (m[0] + 3, m[1]))


@settings(max_examples=500)
@given(data=st.data())
def test_whatever_happens_to_the_messages_an_episode_is_as_it_was_sent(data):
    sender = Sender()
    limit = data.draw(st.sampled_from([2, 3, 100]))
    first_episode = 0
    begins = data.draw(st.lists(st.sampled_from([0, 1000, 2000, 500]), min_size=1, max_size=3))
    for session, begin in enumerate(begins):
        lengths = data.draw(st.lists(st.integers(1, 6), min_size=1, max_size=4))
        shuffled = data.draw(st.integers(0, 2**20))
        sender.session(
            # A stamp that comes twice, for different states, can only be guessed at.
            begin + session, lengths, data.draw(st.integers(0, 6)), first_episode,
            lambda number, shuffled=shuffled: not shuffled >> number % 20 & 1,
        )  # fmt: skip
        first_episode += len(lengths)
    states, samples = list(sender.states), list(sender.samples)
    spoil(data, states, BAD_STATES)
    spoil(data, samples, BAD_SAMPLES)

    assembler = EpisodeAssembler(limit)
    if data.draw(st.booleans()):
        assembler.channel_names = tuple(NAMES)
    received = []
    take_state = data.draw(st.lists(st.booleans(), max_size=len(states) + len(samples)))
    while states or samples:
        is_state = take_state.pop() if take_state else len(states) >= len(samples)
        if is_state and states:
            received += assembler.add_state(*states.pop(0))
        elif samples:
            received += assembler.add_reward(*samples.pop(0))

    pieces = {
        tuple(numbers[i : i + limit]) for numbers, has_ended in sender.episodes
        for i in range(0, len(numbers), limit) if has_ended or i + limit <= len(numbers)
    }  # fmt: skip
    assume(set(assembler.channel_names or NAMES) == set(NAMES))  # The first pair may be spoiled.
    for episode in received:
        numbers = tuple(int(reward) for reward in episode.rewards)
        assert numbers in pieces
        value_of = {'a': numbers, 'b': np.negative(numbers)}
        np.testing.assert_array_equal(
            episode.states, np.column_stack([value_of[name] for name in assembler.channel_names])
        )
