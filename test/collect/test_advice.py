# SPDX-License-Identifier: Apache-2.0

"""What follows from a selection: what to keep, what can go, what is undecided."""

import math
from dataclasses import replace

import pytest
from selections import selection, sensor

from cmifs_ros.collect.advice import advice_fields, advice_lines, advice_of
from cmifs_ros.collect.traffic import Rate
from cmifs_ros.core.effect import Effect

X = sensor('x', is_selected=True, pvalue=0.001, status='confirmed', effect=Effect(0.4, 0.1))
SCAN = sensor(
    'scan', is_selected=True, pvalue=0.01, status='confirmed', channels=('scan[0]', 'scan[1]'),
    effect=Effect(0.1, 0.03),
)  # fmt: skip
NOISE = sensor('noise', pvalue=1.0, status='dispensable', effect=Effect(-0.001, 0.002))
RADIO = replace(NOISE, name='radio', channels=('radio',))
BATTERY = sensor('battery', pvalue=0.4, effect=Effect(0.012, 0.01))


def names(items):
    return [item.name for item in items]


def lists(advice):
    return [names(items) for items in (advice.keep, advice.can_go, advice.undecided)]


def test_sensors_are_kept_or_can_go_by_their_status():
    advice = advice_of(selection(X, NOISE, BATTERY))
    assert lists(advice) == [['x'], ['noise'], ['battery']]
    assert lists(advice_of(selection())) == [[], [], []]
    untested = selection(sensor('x', is_selected=True), sensor('y'))
    assert advice_lines(advice_of(untested)) == []


def test_what_is_selected_stays_since_the_rest_is_dispensable_beside_it():
    chosen = replace(NOISE, is_selected=True)
    advice = advice_of(selection(X, chosen, replace(SCAN, is_selected=False)))
    assert lists(advice) == [['x', 'noise', 'scan'], [], []]
    assert '  noise: adds -0.1%; selected, but not confirmed' in advice_lines(advice)


def test_a_topic_can_go_when_all_its_channels_can():
    topics = {
        'x': '/odom', 'noise': '/odom', 'scan[0]': '/scan', 'scan[1]': '/scan', 'radio': '/radio',
        'battery': '/power',
    }  # fmt: skip
    found = selection(X, SCAN, NOISE, RADIO, BATTERY)
    assert lists(advice_of(found, topics)) == [['/odom', '/scan'], ['/radio'], ['/power']]
    both = topics | {'radio': '/power'}
    assert lists(advice_of(found, both)) == [['/odom', '/scan'], [], ['/power']]


def test_only_the_sensors_that_put_a_topic_into_its_list_are_named():
    topics = {'x': '/odom', 'noise': '/odom', 'battery': '/power', 'radio': '/power'}
    lines = advice_lines(advice_of(selection(X, NOISE, RADIO, BATTERY), topics))
    assert '  /odom: x adds 40.0%' in lines
    assert any(line.startswith('  /power: battery may add up to 3.2%; about') for line in lines)
    assert not any('noise' in line or 'radio' in line for line in lines)


def test_of_a_channel_that_was_not_tested_nothing_is_said():
    advice = advice_of(selection(X, RADIO), {'x': '/x', 'radio': '/radio', 'still': '/radio'})
    assert lists(advice) == [['/x'], [], ['/radio']]
    assert advice.undecided[0].more_episodes is None


def test_messages_and_bytes_are_told_of_each_topic_and_together():
    topics = {'x': '/x', 'noise': '/noise', 'radio': '/radio'}
    rates = {'/noise': Rate(100.0, 2.5e6), '/radio': Rate(0.5, 40.0)}
    lines = advice_lines(advice_of(selection(X, NOISE, RADIO), topics, rates))
    assert 'these can go (together 100 messages/s, 2.5 MB/s):' in lines
    assert '  /noise: noise adds at most 0.2%; 100 messages/s, 2.5 MB/s' in lines
    assert '  /radio: radio adds at most 0.2%; 0.5 messages/s, 40 B/s' in lines
    assert '  /x: x adds 40.0%' in lines
    assert advice_fields(advice_of(selection(X, NOISE, RADIO), topics, rates))['rates'] == {
        '/noise': {'messages_per_s': 100.0, 'bytes_per_s': 2.5e6},
        '/radio': {'messages_per_s': 0.5, 'bytes_per_s': 40.0},
    }
    assert lines[-1] == 'undecided: nothing'


def test_conditions_are_told():
    copy = replace(NOISE, redundant_with=('x',))
    still = replace(RADIO, is_constant=True, effect=Effect(0.0, 0.0))
    lines = advice_lines(advice_of(selection(X, copy, still)))
    assert '  noise: adds at most 0.2%; as long as x stays' in lines
    assert '  radio: adds at most 0.0%; never changed in these episodes' in lines
    topics = {'x': '/x', 'noise': '/noise', 'radio': '/radio'}
    lines = advice_lines(advice_of(selection(X, NOISE, RADIO), topics, needed=['/radio']))
    place = lines.index(
        '  /radio: radio adds at most 0.2%; but actions, steps, the reward or the ends of'
    )
    assert lines[place + 1] == '    episodes need the topic'
    # A program that switches off what can go must not take it.
    fields = advice_fields(advice_of(selection(X, NOISE, RADIO), topics, needed=['/radio']))
    assert (fields['keep'], fields['can_go']) == (['/x', '/radio'], ['/noise'])


@pytest.mark.parametrize(('target', 'what'), [('return', 'return'), ('action', 'controller uses')])
def test_it_is_said_which_question_is_answered(target, what):
    lines = advice_lines(advice_of(selection(X, target=target)))
    assert what in ' '.join(lines[: lines.index('keep these:')])
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize('effect', [Effect(0.012, 0.02), Effect(0.005, 0.02), Effect(0.05, 0.06)])
def test_so_many_more_episodes_would_decide(effect):
    """With the error that they leave, an end of the interval is at 0 or at the margin."""
    (item,) = advice_of(selection(replace(BATTERY, effect=effect))).undecided
    assert str(item.more_episodes)[1:].strip('0') == ''

    def is_decided(episodes):
        error = effect.error * math.sqrt(25 / episodes)
        return effect.share > 1.6449 * error or effect.share + 1.6449 * error < 0.02

    assert is_decided(25 + item.more_episodes)
    assert not is_decided(25 + item.more_episodes / 2.1 - 10)  # It is rounded up, from 10 on.


def test_it_takes_more_episodes_to_confirm_one_of_many():
    share = replace(BATTERY, effect=Effect(0.05, 0.06))
    (alone,) = advice_of(selection(share)).undecided
    many = advice_of(selection(share, *(replace(NOISE, name=f'n{i}') for i in range(99))))
    assert many.undecided[0].more_episodes > 2 * alone.more_episodes


@pytest.mark.parametrize('effect', [None, Effect(0.1, 0.01), Effect(0.01, 1e9), Effect(0.01, 0.0)])
def test_where_the_interval_does_not_tell_no_number_is_guessed(effect):
    advice = advice_of(selection(replace(BATTERY, effect=effect), margin=0.02))
    assert advice_fields(advice)['undecided'] == [{'name': 'battery', 'more_episodes': None}]
    assert 'more episode' not in ' '.join(advice_lines(advice))


@pytest.mark.parametrize('episodes', [2, 19])
def test_from_few_episodes_nothing_can_go_and_it_is_said_what_is_missing(episodes):
    text = ' '.join(advice_lines(advice_of(replace(selection(X, BATTERY), episodes=episodes))))
    assert text.endswith('too few to call a sensor dispensable; expected at least 20, better 50.')
    enough = advice_lines(advice_of(replace(selection(X, BATTERY), episodes=20)))
    assert 'at least 20' not in ' '.join(enough)


@pytest.mark.parametrize(
    ('of_all', 'is_told'), [(0.05, True), (-0.1, True), (0.07, False), (None, False)]
)
def test_it_is_told_if_the_margin_is_a_good_part_of_all_that_is_predicted(of_all, is_told):
    def text(*sensors):
        found = selection(*sensors, margin=0.02, predicted_share_of_all=of_all)
        return ' '.join(advice_lines(advice_of(found)))

    assert ('less than 2.0% may still matter' in text(X, NOISE)) == is_told
    assert 'may still matter' not in text(X, SCAN)


def test_what_is_undecided_is_said_by_its_interval():
    lines = advice_lines(
        advice_of(selection(BATTERY, replace(SCAN, status='undecided', is_selected=False)))
    )
    assert any(line.startswith('  battery: may add up to 3.2%; about') for line in lines)
    assert any(line.startswith('  scan: adds 4.1% to 15.9%') for line in lines)


def test_why_is_said_of_what_is_undecided_below_the_margin():
    small = Effect(-0.015, 0.01)  # At most 0.5 %.
    battery = replace(BATTERY, pvalue=1.0, effect=small, together_with=('yaw', 'x'))
    gyro = replace(BATTERY, name='gyro', channels=('gyro',), pvalue=0.03, effect=small)
    found = selection(X, battery, gyro, level=0.004)
    said = 'may add up to 0.5% (may matter with yaw and 1 more)'
    assert f'  battery: {said}' in advice_lines(advice_of(found))
    lines = advice_lines(advice_of(found, {'battery': '/power', 'gyro': '/imu', 'x': '/x'}))
    assert f'  /power: battery {said}' in lines
    assert '  /imu: gyro may add up to 0.5% (p above 0.004)' in lines


def test_where_much_is_undecided_another_target_is_named():
    batteries = [replace(BATTERY, name=f'b{i}', channels=(f'b{i}',)) for i in range(3)]
    assert '--target decision' in ' '.join(advice_lines(advice_of(selection(X, *batteries))))
    for found in (
        selection(X, *batteries, target='decision'),
        selection(X, NOISE, RADIO, batteries[0]),
    ):
        assert '--target decision' not in ' '.join(advice_lines(advice_of(found)))


def test_all_have_a_line_or_as_many_as_asked_for():
    many = [replace(NOISE, name=f'n{i}', channels=(f'n{i}',)) for i in range(20)]

    def listed(most):
        lines = advice_lines(advice_of(selection(X, *many)), most)
        begin, end = lines.index('these can go:'), lines.index('undecided: nothing')
        return [line.split(':')[0] for line in lines[begin + 1 : end]]

    assert listed(None) == [f'  n{i}' for i in range(20)]
    assert listed(12) == [*(f'  n{i}' for i in range(12)), '  and 8 more']
