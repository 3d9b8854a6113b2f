# SPDX-License-Identifier: Apache-2.0

"""Why a decision needs its sensors, as a small graph."""

from selections import selection, sensor

from cmifs_ros.tools.reason_graph import draw_reasons


def needed(name, why):
    return sensor(name, why=why, is_selected=True, pvalue=0.01, status='confirmed')


def test_each_sensor_stands_left_of_what_it_predicts():
    found = selection(
        needed('x', 'reward'), needed('y', 'predicts x'), needed('wind', 'predicts y'),
        needed('a', 'predicts b'), needed('b', 'predicts a'), sensor('noise', why='reward'),
        target='decision',
    )  # fmt: skip
    (axes,) = draw_reasons(found).axes
    place = {text.get_text(): text.get_position()[0] for text in axes.texts if text.get_text()}
    assert set(place) == {'reward', 'x', 'y', 'wind', 'a', 'b'}
    assert place['reward'] > place['x'] > place['y'] > place['wind'] > place['a'] == place['b']
    arrows = [text for text in axes.texts if not text.get_text()]
    assert len(arrows) == 5


def test_where_nothing_is_needed_there_is_no_graph():
    assert draw_reasons(selection(sensor('x', pvalue=0.9, why='reward'), target='decision')) is None


def test_a_sensor_that_predicts_one_that_is_not_there_stands_alone():
    figure = draw_reasons(selection(needed('x', 'predicts gone'), target='decision'))
    assert [text.get_text() for text in figure.axes[0].texts] == ['reward', 'x']
