# SPDX-License-Identifier: Apache-2.0

"""A selection in words."""

from dataclasses import replace

import pytest
from selections import selection, sensor

from cmifs_ros.collect.selection_report import (
    evidence,
    headline,
    interval,
    is_news,
    is_undecided,
    kinds_of_warnings,
    prediction,
    reason,
    redundancies,
    share,
    undecided_because,
)
from cmifs_ros.core.effect import Effect

PLAIN = selection(sensor('b', 0.5, is_selected=True), sensor('a', 0.4))
SURE = sensor('b', is_selected=True, pvalue=0.01, status='confirmed')
DISPENSABLE = sensor('a', pvalue=1.0, status='dispensable', effect=Effect(-0.001, 0.002))
CONFIRMED = selection(SURE, DISPENSABLE)
UNDECIDED = selection(DISPENSABLE, sensor('c', pvalue=0.4), sensor('b', pvalue=0.2))
NOTHING = selection(DISPENSABLE, replace(DISPENSABLE, name='c'))


def test_the_headline_says_what_is_sure_and_what_is_not():
    assert headline(PLAIN) == 'selected b'
    assert headline(CONFIRMED) == 'selected b'
    assert headline(UNDECIDED) == 'nothing confirmed yet; 25 episodes, best so far b, p = 0.2'
    assert headline(NOTHING) == (
        'no evidence that any sensor is informative about the return in 25 episodes; check '
        'that the reward is that of the task'
    )
    no_reward = selection(DISPENSABLE, target='action')
    assert headline(no_reward) == (
        'no evidence that any sensor is informative about the action in 25 episodes'
    )
    constant = selection(replace(DISPENSABLE, is_constant=True))
    assert headline(constant) == 'no sensor changed in 25 episodes: nothing can be selected'
    assert [is_undecided(s) for s in (PLAIN, CONFIRMED, UNDECIDED, NOTHING)] == [
        False, False, True, False,
    ]  # fmt: skip


def test_the_evidence_is_p_values_where_there_are_some_and_else_scores():
    assert evidence(PLAIN) == 'b (0.500); not selected: a (0.400); 25 episodes, 60 steps, 1.2 s'
    assert evidence(NOTHING) == 'dispensable: a, c; 25 episodes, 60 steps, 1.2 s'
    assert evidence(CONFIRMED) == (
        'b (adds 12.5%, p 0.01); dispensable: a; 25 episodes, 60 steps, 1.2 s'
    )


def test_the_p_value_that_is_needed_is_said_where_something_is_undecided():
    found = replace(selection(SURE, sensor('c', pvalue=0.02)), level=0.0083)
    assert '; not selected: c (adds 12.5%, p 0.02), needed: p <= 0.0083; 25' in evidence(found)
    assert headline(replace(UNDECIDED, level=0.0083)).endswith('p = 0.2, needed: p <= 0.0083')


@pytest.mark.parametrize(
    ('more', 'episodes', 'because'),
    [
        ({'pvalue': 0.02}, 25, 'p above 0.0083'),
        ({'pvalue': 0.2}, 25, 'wide interval'),
        ({'pvalue': 0.2, 'together_with': ('b',)}, 25, 'may matter with b'),
        ({'pvalue': 0.2, 'together_with': tuple('bcd')}, 25,
         'may matter with b and 2 more'),
        ({'pvalue': 0.2}, 19, 'few episodes'),
        ({'pvalue': 0.001, 'status': 'confirmed'}, 25, ''),
        ({'pvalue': 0.9, 'status': 'dispensable'}, 25, ''),
    ],
)  # fmt: skip
def test_it_is_said_why_a_sensor_is_undecided(more, episodes, because):
    one = sensor('a', **more)
    found = replace(selection(one), level=0.0083, episodes=episodes)
    assert undecided_because(found, one) == because


def test_shares_are_percentages():
    assert [share(v) for v in (0.1234, -0.0001, -0.0012, 1.0)] == [
        '12.3%',
        '0.0%',
        '-0.1%',
        '100.0%',
    ]
    assert interval(Effect(0.5, 0.1)) == '30.4% to 69.6%'
    assert interval(Effect(-0.026, 0.117)) == 'below 20.3%'
    assert interval(Effect(-0.5, 0.1)) == 'below 0.0%'


def test_it_is_said_how_much_the_selected_predict_beside_all():
    known = {'predicted_share': 0.484, 'predicted_share_of_all': 0.239}
    assert prediction(selection(SURE, DISPENSABLE, **known)) == (
        'the 1 selected of 2 sensors predicts 48% of the variance of the return in episodes left '
        'out; all together, 24% (the others make it harder to learn)'
    )
    of_action = prediction(selection(DISPENSABLE, target='action', **known))
    assert of_action.startswith('all sensors together predict 24% of the variance of the action')
    every = prediction(selection(SURE, target='decision', **known))
    assert every.startswith('all sensors are selected, and predict 48% of the')
    nothing = prediction(selection(DISPENSABLE, predicted_share=0.0, predicted_share_of_all=-0.2))
    assert nothing.startswith('all sensors together predict 0% of')
    assert prediction(PLAIN) == ''


@pytest.mark.parametrize(
    ('sensors', 'of_none', 'end'),
    [
        ((SURE, DISPENSABLE), 0.36, 'all together, 70%; without any sensor, the step and the '
         'action alone: 36%'),
        ((SURE, DISPENSABLE), 0.3, 'all together, 70%'),
        ((SURE,), 0.71, 'without any sensor, the step and the action alone: 71%'),
        ((DISPENSABLE,), 0.36, 'without any sensor, the step and the action alone: 36%'),
        ((DISPENSABLE,), 0.29, 'in episodes left out'),
        ((DISPENSABLE,), None, 'in episodes left out'),
    ],
)  # fmt: skip
def test_a_return_that_mostly_follows_the_step_or_the_action_is_not_credited_to_sensors(
    sensors, of_none, end
):
    shares = {'predicted_share': 0.7, 'predicted_share_of_all': 0.7}
    shown = selection(*sensors, **shares, predicted_share_of_none=of_none)
    assert prediction(shown).endswith(end)


def decided(name, why, **more):
    more = {'is_selected': True, 'pvalue': 0.01, 'status': 'confirmed'} | more
    return sensor(name, why=why, **more)


@pytest.mark.parametrize(
    ('whys', 'expected'),
    [
        (['reward', 'predicts a', 'predicts b'], 'predicts b -> a -> reward'),
        (['reward', 'predicts a', 'reward'], 'reward'),
        # A circle does not lead anywhere: the first link is what is known.
        (['predicts b', 'predicts a', 'predicts a'], 'predicts a'),
        (['predicts c', 'reward', 'predicts a'], 'predicts a'),
        (['reward', 'predicts a', 'predicts gone'], 'predicts gone'),
    ],
)
def test_a_decision_says_why_as_a_chain_to_the_reward(whys, expected):
    sensors = [decided(name, why) for name, why in zip('abc', whys, strict=True)]
    found = selection(*sensors, target='decision')
    assert reason(found, sensors[2]) == expected
    assert reason(selection(*sensors), sensors[2]) == ''


def test_a_chain_goes_by_the_channels_of_a_sensor():
    pose = decided('pose', 'reward', channels=('pose.x', 'pose.y'))
    wind = decided('wind', 'predicts pose.y')
    assert reason(selection(pose, wind, target='decision'), wind) == 'predicts pose.y -> reward'


def test_no_reason_is_given_for_what_has_no_evidence():
    a, b = decided('a', 'reward'), sensor('b', pvalue=0.9, why='predicts a')
    assert reason(selection(a, b, target='decision'), b) == ''


def test_warnings_that_differ_by_numbers_are_of_a_kind():
    said = ['38% of the steps are in two episodes', '41% of the steps are in two episodes']
    assert list(kinds_of_warnings(said).values()) == said[1:]
    assert len(kinds_of_warnings([*said, 'the action follows from the sensors (51% of it)'])) == 2


def test_redundant_sensors_are_named():
    four = selection(
        SURE,
        sensor('a', is_selected=True, pvalue=0.02, status='confirmed'),
        replace(DISPENSABLE, name='c', redundant_with=('b', 'a')),
        replace(DISPENSABLE, name='d', redundant_with=('b',)),
    )
    assert redundancies(four) == 'c with b and a, d with b'
    assert '; dispensable: c, d; redundant: c with b and a, d with b; 25 episodes' in evidence(four)
    assert redundancies(PLAIN) == ''


def test_a_long_name_does_not_hide_its_evidence():
    long = selection(replace(SURE, name='n' * 40), DISPENSABLE)
    assert evidence(long).startswith(f'{"n" * 30}.. (adds 12.5%, p 0.01); ')


def test_news_is_another_set_or_another_certainty():
    assert is_news(PLAIN, None)
    assert not is_news(selection(replace(SURE, score=0.6), DISPENSABLE), PLAIN)
    assert is_news(UNDECIDED, CONFIRMED)
    assert is_news(selection(sensor('a', is_selected=True)), PLAIN)
