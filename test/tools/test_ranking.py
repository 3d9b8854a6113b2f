from dataclasses import replace

import pytest

from cmifs_ros.core.selection import Selection
from cmifs_ros.tools.ranking import draw_ranking, ranking_text

BARE = Selection((0,), ('x',), ('x', 'scan', 'still'), (0.25, 0.5, -0.1), 12, 60, 1.5)
FULL = replace(
    BARE,
    statuses=('confirmed', 'tentative', 'rejected'),
    pvalues=(0.0012, 0.2, 1.0),
    null_scores=((-0.01, 0.0, 0.02), (0.24, 0.25, 0.27), (0.35, 0.36, 0.37)),
    supporting_channels=(('x',), ('scan[6]', 'scan[7]', 'scan[8]', 'scan[9]'), ('still',)),
)


def test_the_table_has_the_evidence_where_there_is_some():
    assert [line.split() for line in ranking_text(BARE).splitlines()] == [
        ['rank', 'sensor', 'score'],
        ['1', 'x', '0.250'],
        ['2', 'scan', '0.500'],
        ['3', 'still', '-0.100'],
    ]
    assert [line.split() for line in ranking_text(FULL).splitlines()[1:]] == [
        ['1', 'x', '0.250', '-0.010', 'to', '0.020', '0.0012', 'confirmed'],
        [
            '2',
            'scan',
            '0.500',
            '0.240',
            'to',
            '0.270',
            '0.2',
            'tentative',
            'scan[6],',
            'scan[7]',
            'and',
            '2',
            'more',
        ],
        ['3', 'still', '-0.100', '0.350', 'to', '0.370', '1', 'rejected'],
    ]


def test_the_table_names_redundant_sensors():
    head, *lines = ranking_text(replace(FULL, redundant_with=((), ('x',), ()))).splitlines()
    assert head.endswith('redundant with')
    assert [line.endswith(' x') for line in lines] == [False, True, False]


def test_sensors_that_never_changed_stand_below_the_table_and_in_no_picture():
    still = replace(FULL, supporting_channels=(*FULL.supporting_channels[:2], ()))
    assert still.num_live == 2
    *_, last, below = ranking_text(still).splitlines()
    assert 'scan' in last
    assert below == 'never changed: still'
    axes = draw_ranking(still).figure.axes
    assert [label.get_text() for label in axes[-1].get_xticklabels()] == ['x', 'scan']
    nothing = replace(still, supporting_channels=((),) * 3)
    assert ranking_text(nothing).splitlines()[1:] == ['never changed: x, scan, still']
    draw_ranking(nothing)


def dots_of(axes):
    lines = [line for line in axes.lines if line.get_marker() == 'o']
    return sorted((x, y) for line in lines for x, y in line.get_xydata().tolist())


@pytest.mark.parametrize('selection', [BARE, FULL, replace(FULL, indices=(), names=())])
def test_the_picture_shows_band_scores_and_statuses(selection):
    figure = draw_ranking(selection)
    axes = figure.axes[0]
    shown = {text.get_text() for text in axes.get_legend().get_texts()}
    assert set(selection.statuses) <= shown
    assert ('its median' in shown) == bool(selection.null_scores)
    expected = [selection.scores, *([selection.pvalues] if selection.pvalues else [])]
    assert [dots_of(part) for part in figure.axes] == [list(enumerate(v)) for v in expected]


def test_the_picture_parts_the_selected_from_those_that_are_scored_beside_them():
    axes = draw_ranking(FULL).figure.axes[0]
    assert {text.get_text() for text in axes.texts} == {
        'selected: each with those before it', 'others: each with the selected alone',
    }  # fmt: skip
    for whole in (BARE, replace(FULL, indices=(), names=())):
        assert not draw_ranking(whole).figure.axes[0].texts
