"""A selection in words."""

from dataclasses import replace

from selections import selection, sensor

from cmifs_ros.collect.selection_report import (
    evidence,
    headline,
    is_news,
    is_tentative,
    redundancies,
)

PLAIN = selection(sensor('b', 0.5, is_selected=True), sensor('a', 0.4))
SURE = sensor('b', is_selected=True, pvalue=0.01, status='confirmed')
REJECTED = sensor('a', pvalue=1.0, status='rejected')
CONFIRMED = selection(SURE, REJECTED)
TENTATIVE = selection(REJECTED, sensor('c', pvalue=0.4), sensor('b', pvalue=0.2))
NOTHING = selection(REJECTED, replace(REJECTED, name='c'))


def test_the_headline_says_what_is_sure_and_what_is_not():
    assert headline(PLAIN) == 'selected b'
    assert headline(CONFIRMED) == 'selected b'
    assert headline(TENTATIVE) == 'nothing confirmed yet; 25 episodes, best so far b, p = 0.2'
    assert headline(NOTHING) == (
        'no evidence that any sensor is informative about the return; 25 episodes, and more may '
        'show it if the reward is that of the task'
    )
    constant = selection(replace(REJECTED, is_constant=True))
    assert headline(constant) == 'no sensor changed in 25 episodes: nothing can be selected'
    assert [is_tentative(s) for s in (PLAIN, CONFIRMED, TENTATIVE, NOTHING)] == [
        False, False, True, False,
    ]  # fmt: skip


def test_the_evidence_is_p_values_where_there_are_some_and_else_scores():
    assert evidence(PLAIN) == 'b (0.500), a (0.400); 25 episodes, 60 steps, 1.2 s'
    assert evidence(NOTHING) == 'rejected a, c; 25 episodes, 60 steps, 1.2 s'
    assert evidence(CONFIRMED) == 'b (p 0.01); rejected a; 25 episodes, 60 steps, 1.2 s'


def test_redundant_sensors_are_named():
    four = selection(
        SURE,
        sensor('a', is_selected=True, pvalue=0.02, status='confirmed'),
        replace(REJECTED, name='c', redundant_with=('b', 'a')),
        replace(REJECTED, name='d', redundant_with=('b',)),
    )
    assert redundancies(four) == 'c with b and a, d with b'
    assert '; rejected c, d; redundant: c with b and a, d with b; 25 episodes' in evidence(four)
    assert redundancies(PLAIN) == ''


def test_a_long_name_does_not_hide_its_evidence():
    long = selection(replace(SURE, name='n' * 40), REJECTED)
    assert evidence(long).startswith(f'{"n" * 30}.. (p 0.01); ')


def test_news_is_another_set_or_another_certainty():
    assert is_news(PLAIN, None)
    assert not is_news(selection(replace(SURE, score=0.6), REJECTED), PLAIN)
    assert is_news(TENTATIVE, CONFIRMED)
    assert is_news(selection(sensor('a', is_selected=True)), PLAIN)
