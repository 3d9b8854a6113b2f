# SPDX-License-Identifier: Apache-2.0

import json

import pytest
from selections import selection, sensor

from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.collect.sensor_topics import SensorTopics, sensor_topics_of, topic_fields
from cmifs_ros.collect.traffic import Rate
from cmifs_ros.core.effect import Effect

TOPICS = SensorTopics({'x': '/a', 'y': '/b'}, {'/a': Rate(10.0, 1234.0), '/b': Rate(0.5, 6.0)}, ())


def test_what_is_sent_arrives_with_three_digits():
    sent = TOPICS._replace(needed=('/a',))
    found = sensor_topics_of(json.loads(json.dumps(topic_fields(sent))))
    assert found == sent._replace(rates={'/a': Rate(10.0, 1230.0), '/b': Rate(0.5, 6.0)})


def test_the_advice_of_a_selection_is_then_of_topics():
    found = selection(
        sensor('x', pvalue=0.001, is_selected=True, effect=Effect(0.5, 0.01)),
        sensor('y', pvalue=1.0, status='dispensable', effect=Effect(0.0, 0.001)),
    )
    assert fields_of(found)['advice']['can_go'] == ['y']
    assert fields_of(found, TOPICS)['advice'] == {
        'keep': ['/a'], 'can_go': ['/b'], 'undecided': [], 'rates': topic_fields(TOPICS)['rates'],
    }  # fmt: skip


@pytest.mark.parametrize(
    'bad',
    [
        [], None, {'rates': None}, {'channels': ['x']}, {'channels': {'x': ''}},
        {'channels': {'x': 5}}, {'rates': {'/a': {'messages_per_s': -1, 'bytes_per_s': 0}}},
        {'rates': {'/a': {'messages_per_s': 'inf', 'bytes_per_s': 0}}}, {'rates': {'/a': 3}},
        {'rates': {'/a': {'messages_per_s': 10**400, 'bytes_per_s': 0}}},
        {'needed': 'y' * 5000}, {'needed': 3}, {'needed': ['/\ud800']},
    ],
)  # fmt: skip
def test_what_is_something_else_is_refused(bad):
    good = topic_fields(TOPICS)
    with pytest.raises((ValueError, TypeError, KeyError, AttributeError)):
        sensor_topics_of(good | bad if isinstance(bad, dict) else bad)
    for key in good:
        with pytest.raises(KeyError):
            sensor_topics_of({k: v for k, v in good.items() if k != key})
