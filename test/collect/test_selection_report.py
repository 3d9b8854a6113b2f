"""A selection in words."""

import dataclasses

from cmifs_ros.collect.selection_report import (
    evidence,
    headline,
    is_news,
    is_tentative,
    redundancies,
    reply_of,
)
from cmifs_ros.core.selection import Selection

PLAIN = Selection((1,), ('b',), ('b', 'a'), (0.5, 0.4), 25, 60, 1.25, (0.0, 1.0), (1.0, 1.0))
CONFIRMED = dataclasses.replace(PLAIN, statuses=('confirmed', 'rejected'), pvalues=(0.01, 0.8))
TENTATIVE = dataclasses.replace(
    PLAIN, indices=(), names=(), statuses=('tentative', 'rejected'), pvalues=(0.2, 1.0)
)


def test_the_headline_says_what_is_sure_and_what_is_not():
    assert headline(PLAIN) == 'selected b'
    assert headline(CONFIRMED) == 'selected b'
    assert headline(TENTATIVE) == ('nothing confirmed yet; 25 episodes, best so far b, p = 0.2')
    nothing = dataclasses.replace(TENTATIVE, statuses=('rejected',) * 2, pvalues=(1.0, 1.0))
    assert headline(nothing) == (
        'no evidence that any sensor tells about the return; 25 episodes, and more may show it if '
        'the reward is what the task pays'
    )
    assert [is_tentative(s) for s in (PLAIN, CONFIRMED, TENTATIVE, nothing)] == [
        False, False, True, False,
    ]  # fmt: skip


def test_the_evidence_is_p_values_where_there_are_some_and_else_scores():
    assert evidence(PLAIN) == 'b (0.500), a (0.400); 25 episodes, 60 steps, 1.2 s'
    nothing = dataclasses.replace(CONFIRMED, statuses=('rejected',) * 2)
    assert evidence(nothing) == 'rejected b, a; 25 episodes, 60 steps, 1.2 s'
    assert evidence(CONFIRMED) == 'b (p 0.01); rejected a; 25 episodes, 60 steps, 1.2 s'


def test_redundant_sensors_are_named():
    three = dataclasses.replace(
        PLAIN,
        ranking=('b', 'a', 'c', 'd'),
        statuses=('confirmed', 'confirmed', 'rejected', 'rejected'),
        pvalues=(0.01, 0.02, 1.0, 1.0),
        redundant_with=((), (), ('b', 'a'), ('b',)),
    )
    assert redundancies(three) == 'c with b and a, d with b'
    assert '; rejected c, d; redundant: c with b and a, d with b; 25 episodes' in evidence(three)
    assert redundancies(PLAIN) == ''


def test_a_long_name_does_not_hide_its_evidence():
    long = dataclasses.replace(CONFIRMED, names=('n' * 40,), ranking=('n' * 40, 'a'))
    assert evidence(long).startswith(f'{"n" * 30}.. (p 0.01); ')


def test_the_reply_has_no_empty_evidence_and_nothing_of_the_data():
    assert set(reply_of(PLAIN)) == {
        'indices', 'names', 'ranking', 'scores', 'episodes', 'steps', 'seconds', 'outdated',
    }  # fmt: skip
    assert reply_of(CONFIRMED)['pvalues'] == (0.01, 0.8)


def test_news_is_another_set_or_another_certainty():
    assert is_news(PLAIN, None)
    assert not is_news(dataclasses.replace(PLAIN, scores=(0.6, 0.5)), PLAIN)
    assert is_news(TENTATIVE, CONFIRMED)
    assert is_news(dataclasses.replace(PLAIN, names=('a',)), PLAIN)
