# SPDX-License-Identifier: Apache-2.0

"""A selection as JSON, and what comes of JSON that is none."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from selections import selection, sensor

from cmifs_ros.collect.selection_fields import VERSION, fields_of, selection_of
from cmifs_ros.core.channel_names import MAX_NAME_LENGTH
from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import SensorResult
from cmifs_ros.core.targets import TARGETS

names = st.text(min_size=1, max_size=9)
numbers = st.floats(allow_nan=False)
shares = st.floats(-9, 9)


@st.composite
def selections(draw):
    found = []
    for name in draw(st.lists(names, max_size=4, unique=True)):
        channels = tuple(f'{name}[{i}]' for i in range(draw(st.integers(1, 3))))
        is_tested = draw(st.booleans())
        found.append(
            SensorResult(
                name,
                channels,
                draw(st.booleans()),
                draw(numbers),
                is_constant=draw(st.booleans()),
                null_band=draw(st.none() | st.tuples(numbers, numbers, numbers)),
                pvalue=draw(st.floats(0, 1)) if is_tested else None,
                status='undecided' if is_tested else None,
                supporting_channels=channels[:1],
                redundant_with=draw(st.sampled_from([(), ('x',), ('x', 'y')])),
                stability=draw(st.none() | st.floats(0, 1)),
                effect=draw(st.none() | st.builds(Effect, shares, st.floats(0, 9))),
                why=draw(st.text(max_size=20)),
            )
        )
    return replace(
        selection(*found),
        number=draw(st.integers(0, 10**6)),
        outdated=3,
        target=draw(st.sampled_from(TARGETS)),
        gamma=draw(st.none() | numbers),
        predicted_share=draw(st.none() | numbers),
        predicted_share_of_all=draw(st.none() | numbers),
        predicted_share_of_none=draw(st.none() | numbers),
        margin=draw(st.none() | st.floats(0, 1, exclude_min=True, exclude_max=True)),
        warnings=tuple(draw(st.lists(st.text(max_size=1000), max_size=3))),
        losses=draw(st.text(max_size=1000)),
    )


@given(selections())
def test_what_is_said_is_read(sent):
    assert selection_of(json.loads(json.dumps(fields_of(sent)))) == sent


GOOD = selection(
    sensor('x', pvalue=0.01, status='confirmed', is_selected=True), sensor('y'), number=2
)


def test_the_selected_and_the_ranking_can_be_read_without_going_through_the_sensors():
    said = json.loads(json.dumps(fields_of(GOOD)))
    assert (said['names'], said['indices']) == (['x'], [0])
    assert (said['ranking'], said['scores']) == (['x', 'y'], [0.5, 0.5])
    assert (said['version'], said['number']) == (VERSION, 2)
    assert not {'means', 'spreads'} & set(said)


def test_an_effect_is_said_with_its_interval():
    said = fields_of(selection(sensor('x', pvalue=0.01, effect=Effect(0.5, 0.1))))
    effect = said['sensors'][0]['effect']
    assert (effect['share'], effect['error']) == (0.5, 0.1)
    # Of a normal distribution 95 % are within 1.96 standard errors.
    assert [effect['low'], effect['high']] == pytest.approx([0.304, 0.696], abs=1e-4)


def test_what_follows_is_said_too():
    undecided = sensor('y', pvalue=0.2, effect=Effect(0.01, 0.02))
    assert fields_of(replace(GOOD, sensors=(GOOD.sensors[0], undecided)))['advice'] == {
        'keep': ['x'], 'can_go': [], 'undecided': [{'name': 'y', 'more_episodes': 300}],
        'rates': {},
    }  # fmt: skip


def test_the_longest_name_can_be_predicted():
    why = f'predicts {"n" * MAX_NAME_LENGTH}'
    sent = selection(sensor('x', pvalue=0.01, why=why), target='decision')
    assert selection_of(json.loads(json.dumps(fields_of(sent)))) == sent


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'version': 1}, 'a selection of version 1; expected 2'),
        ({'target': 'fun'}, "target 'fun'; expected one of return, decision, action"),
        ({'predicted_share': 'much'}, 'much'),
        ({'margin': []}, 'list'),
        ({'margin': 0}, 'margin 0.0; expected 0 < margin < 1'),
        ({'warnings': 'beware'}, 'str instead of a list'),
        ({'losses': 7}, '7 instead of a text of at most 1000'),
        ({'warnings': [7]}, '7 instead of a text of at most 1000'),
        ({'warnings': ['x' * 1001]}, 'instead of a text of at most 1000'),
        ({'doubt': '\ud800'}, 'surrogates'),
        ({'warnings': ['x'] * 101}, '101 warnings; expected at most 100'),
        ({'indices': [10**9]}, 'index 1000000000; expected less than'),
        ({'indices': [0, 1]}, '2 indices for 1 selected channels'),
        ({'indices': [0.0]}, '0.0 instead of an integer'),
        ({'means': [1.0]}, '1 means for 0 spreads'),
        ({'sensors': [fields_of(GOOD)['sensors'][0]] * 2}, '2 names; expected at most .*distinct'),
        ({'sensors': 'x'}, 'str instead of a list'),
    ],
)
def test_what_cannot_be_is_refused(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        selection_of(json.loads(json.dumps(fields_of(GOOD) | change)))


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'status': 'sure'}, "status 'sure'; expected one of confirmed, undecided, dispensable"),
        ({'pvalue': None}, "status 'confirmed' with pvalue None; expected both"),
        ({'null_band': [1.0]}, 'not enough values'),
        ({'redundant_with': [7]}, 'instead of a text of 1 to 256'),
        ({'is_selected': 1}, '1 instead of true or false'),
        ({'score': 'high'}, 'high'),
        ({'name': ''}, 'instead of a text of 1 to 256'),
        ({'name': '\ud800'}, 'surrogates'),
        ({'why': None}, 'None instead of a text'),
        ({'why': 'x' * 1001}, 'instead of a text of at most'),
        ({'effect': {'share': 0.1}}, 'error'),
        ({'effect': {'share': 0.1, 'error': -0.1}}, 'error -0.1; expected at least 0'),
        ({'effect': {'share': 0.1, 'error': float('nan')}}, 'error nan; expected at least 0'),
        ({'effect': 0.1}, 'float'),
    ],
)
def test_a_sensor_that_cannot_be_is_refused(change, message):
    said = json.loads(json.dumps(fields_of(GOOD)))
    said['sensors'][0] |= change
    with pytest.raises((ValueError, TypeError, KeyError), match=message):
        selection_of(said)


def test_the_page_lists_every_field():
    page = Path(__file__).parents[2] / 'docs' / 'interface.md'
    part = page.read_text().partition('## The selection')[2].partition('\n## ')[0]
    listed = re.findall(r'^\| `(\w+)`', part, re.M)
    expected = [*fields_of(GOOD), *(field.name for field in fields(SensorResult))]
    assert sorted(listed) == sorted(expected)
