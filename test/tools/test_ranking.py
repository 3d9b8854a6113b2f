from dataclasses import replace

import pytest
from selections import selection, sensor

from cmifs_ros.tools.ranking import draw_ranking, ranking_text

BARE = selection(
    sensor('x', 0.25, is_selected=True), sensor('scan', 0.5, is_selected=True),
    sensor('still', -0.1, is_selected=True),
)  # fmt: skip
RAYS = tuple(f'scan[{i}]' for i in range(6, 10))
X = sensor('x', 0.25, is_selected=True, pvalue=0.0012, status='confirmed')
SCAN = sensor('scan', pvalue=0.2, null_band=(0.24, 0.25, 0.27), supporting_channels=RAYS)
STILL = sensor('still', -0.1, pvalue=1.0, status='rejected', null_band=(0.35, 0.36, 0.37))
FULL = selection(X, SCAN, STILL)
NOTHING = selection(replace(X, is_selected=False), SCAN, STILL)


def test_the_table_has_the_evidence_where_there_is_some():
    assert ranking_text(BARE).splitlines() == [
        'rank  sensor   score',
        '   1  x        0.250',
        '   2  scan     0.500',
        '   3  still   -0.100',
    ]
    assert ranking_text(FULL).splitlines() == [
        'rank  sensor   score        null band       p  status     supporting channels',
        '   1  x        0.250  -0.010 to 0.020  0.0012  confirmed',
        '   2  scan     0.500   0.240 to 0.270     0.2  tentative  scan[6], scan[7] and 2 more',
        '   3  still   -0.100   0.350 to 0.370       1  rejected',
    ]


def test_the_table_names_redundant_sensors():
    redundant = selection(X, replace(SCAN, redundant_with=('x',)), STILL)
    head, *lines = ranking_text(redundant).splitlines()
    assert head.endswith('redundant with')
    assert [line.endswith(' x') for line in lines] == [False, True, False]


def test_sensors_that_never_changed_stand_below_the_table_and_in_no_picture():
    constant = replace(STILL, is_constant=True, null_band=None, supporting_channels=())
    still = selection(X, SCAN, constant)
    *_, last, below = ranking_text(still).splitlines()
    assert 'scan' in last
    assert below == 'never changed: still'
    axes = draw_ranking(still).figure.axes
    assert [label.get_text() for label in axes[-1].get_xticklabels()] == ['x', 'scan']
    nothing = selection(constant, replace(constant, name='off'))
    assert ranking_text(nothing).splitlines()[1:] == ['never changed: still, off']
    draw_ranking(nothing)


def dots_of(axes):
    lines = [line for line in axes.lines if line.get_marker() == 'o']
    return sorted((x, y) for line in lines for x, y in line.get_xydata().tolist())


@pytest.mark.parametrize('found', [BARE, FULL, NOTHING])
def test_the_picture_shows_band_scores_and_statuses(found):
    figure = draw_ranking(found)
    axes = figure.axes[0]
    shown = {text.get_text() for text in axes.get_legend().get_texts()}
    assert {sensor.status for sensor in found.sensors} - {None} <= shown
    pvalues = [sensor.pvalue for sensor in found.sensors]
    assert ('its median' in shown) == (pvalues[0] is not None)
    expected = [found.scores, *([pvalues] if pvalues[0] is not None else [])]
    assert [dots_of(part) for part in figure.axes] == [list(enumerate(v)) for v in expected]


def test_the_picture_parts_the_selected_from_those_that_are_scored_beside_them():
    axes = draw_ranking(FULL).figure.axes[0]
    assert {text.get_text() for text in axes.texts} == {
        'selected: each with those before it', 'others: each with the selected alone',
    }  # fmt: skip
    for whole in (BARE, NOTHING):
        assert not draw_ranking(whole).figure.axes[0].texts
