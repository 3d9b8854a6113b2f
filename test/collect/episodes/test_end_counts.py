# SPDX-License-Identifier: Apache-2.0

from cmifs_ros.collect.episodes.end_counts import EndCounts


def test_losses_that_depend_on_the_end_are_told():
    ends = EndCounts()
    for _ in range(40):
        ends.add('succeeded')
    ends.add_lost('succeeded', 'a step lacks light')
    assert not ends.problem()
    for _ in range(12):
        ends.add_lost('aborted', 'a step lacks range')
    said = (
        'episodes that ended by `aborted`: a step lacks range; none of 12 is left, but 40 of 41 '
        'that ended otherwise'
    )
    assert ends.problem() == f'dropped 12 {said}'
    assert ends.dropped_in_words()[said] == 12


def test_the_counts_of_recordings_are_added():
    first, second = EndCounts(), EndCounts()
    for _ in range(2):
        first.add_lost('aborted', 'a step lacks range')
        second.add_lost('aborted', 'a step lacks range')
        first.add('succeeded')
        second.add_shortened('succeeded', 'they lack light')
    assert not first.problem()
    total = sum((first, second), EndCounts())
    assert total.ended == {'aborted': 4, 'succeeded': 4}
    assert total.lost == {'aborted': {'a step lacks range': 4}}
    assert total.shortened == {'succeeded': {'they lack light': 2}}
    assert 'none of 4 is left, but 4 of 4' in total.problem()
    assert first.lost == {'aborted': {'a step lacks range': 2}}


def test_no_end_is_set_apart_if_all_episodes_are_lost():
    ends = EndCounts()
    for kind in ('succeeded', 'succeeded', 'aborted'):
        ends.add_lost(kind, f'a step lacks {"a_channel_with_a_long_name" * 2}')
    assert list(ends.dropped_in_words()) == [
        f'episodes that ended by `{kind}`: a step lacks {"a_channel_with_a_long_name" * 2}; none '
        f'of {count} is left, and none of {3 - count} that ended otherwise'
        for kind, count in (('succeeded', 2), ('aborted', 1))
    ]


def test_losses_at_random_are_counted_and_no_problem():
    ends = EndCounts()
    for kind in ('terminated', 'truncated'):
        for i in range(20):
            (ends.add_lost(kind, 'a step lacks x') if i % 4 == 0 else ends.add(kind))
    assert not ends.problem()
    assert [ends.num_lost(kind) for kind in ends.ended] == [5, 5]
    assert list(ends.dropped_in_words().values()) == [5, 5]
