# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import pytest
from selections import selection, sensor

from cmifs_ros.core.effect import Effect
from cmifs_ros.tools.ranking import draw_ranking, draw_scores, ranking_text

BARE = selection(
    sensor('x', 0.25, is_selected=True), sensor('scan', 0.5, is_selected=True),
    sensor('still', -0.1, is_selected=True),
)  # fmt: skip
RAYS = tuple(f'scan[{i}]' for i in range(6, 10))
X = sensor('x', 0.25, is_selected=True, pvalue=0.0012, status='confirmed', effect=Effect(0.4, 0.1))
SCAN = sensor('scan', pvalue=0.2, null_band=(0.24, 0.25, 0.27), supporting_channels=RAYS)
STILL = sensor(
    'still', -0.1, pvalue=1.0, status='dispensable', null_band=(0.35, 0.36, 0.37),
    effect=Effect(-0.001, 0.002),
)  # fmt: skip
FULL = selection(X, SCAN, STILL, predicted_share=0.5, predicted_share_of_all=0.25)
NOTHING = selection(replace(X, is_selected=False), SCAN, STILL)


def test_the_table_has_the_evidence_where_there_is_some():
    assert ranking_text(BARE).splitlines() == [
        'rank  sensor   score',
        '   1  x        0.250',
        '   2  scan     0.500',
        '   3  still   -0.100',
    ]
    assert ranking_text(FULL).splitlines() == [
        'rank  sensor   adds   95 % interval  status            p  why            '
        'supporting channels',
        '   1  x       40.0%  20.4% to 59.6%  confirmed    0.0012',
        '   2  scan    12.5%   0.3% to 24.7%  undecided       0.2  wide interval  '
        'scan[6], scan[7] and 2 more',
        '   3  still   -0.1%      below 0.3%  dispensable       1',
        'the 1 selected of 3 sensors predicts 50% of the variance of the return in',
        'episodes left out; all together, 25% (the others make it harder to learn)',
    ]


def test_warnings_stand_above_the_table_in_lines_that_are_short():
    warned = replace(FULL, warnings=('the data are bad ' * 6, 'less so'))
    lines = ranking_text(warned).splitlines()
    assert lines[0].startswith('warning: the data are bad')
    assert lines[1].startswith('  ')
    assert lines[2:4] == ['warning: less so', '']
    assert lines[4].startswith('rank')
    assert max(map(len, lines[:4])) <= 80


def test_a_decision_says_why():
    why = [replace(X, why='reward'), replace(SCAN, is_selected=True, why='predicts x')]
    head, *lines = ranking_text(selection(*why, STILL, target='decision')).splitlines()
    start = head.index('why')
    assert [line[start:].split('  ')[0] for line in lines] == ['reward', 'predicts x -> reward', '']


def test_the_table_names_redundant_sensors():
    redundant = selection(X, replace(SCAN, redundant_with=('x',)), STILL)
    head, *lines = ranking_text(redundant).splitlines()[:4]
    assert head.endswith('redundant with')
    assert [line.endswith(' x') for line in lines] == [False, True, False]


def test_sensors_that_never_changed_stand_below_the_table_and_in_no_picture():
    constant = replace(STILL, is_constant=True, null_band=None, supporting_channels=())
    still = selection(X, SCAN, constant)
    *_, last, below = ranking_text(still).splitlines()
    assert 'scan' in last
    assert below == 'constant: still'
    axes = draw_ranking(still).figure.axes
    assert [label.get_text() for label in axes[-1].get_yticklabels()] == ['x', 'scan']
    nothing = selection(constant, replace(constant, name='off'))
    assert ranking_text(nothing).splitlines()[1:] == ['constant: still, off']
    draw_ranking(nothing)


def bars_of(axes):
    return sorted((round(b.get_y() + b.get_height() / 2), b.get_width()) for b in axes.patches)


def legend_of(axes):
    return {text.get_text() for text in axes.get_legend().get_texts()}


@pytest.mark.parametrize('found', [FULL, NOTHING])
def test_the_picture_leads_with_effects_in_percent_with_intervals_and_margin(found):
    (axes,) = draw_ranking(found).axes
    assert bars_of(axes) == [(0, 40.0), (1, 12.5), (2, -0.1)]
    assert axes.yaxis_inverted()
    assert legend_of(axes) == {'confirmed', 'undecided', 'dispensable', 'margin: 2%'}
    texts = [text.get_text() for text in axes.texts]
    assert texts == ['p = 0.0012', 'p = 0.2', 'p = 1']
    whiskers = [segment for lines in axes.collections for segment in lines.get_segments()]
    ends = sorted((row[0][1], row[0][0], row[1][0]) for row in whiskers)
    expected = [(i, 100 * s.effect.low, 100 * s.effect.high) for i, s in enumerate(found.sensors)]
    assert ends == [pytest.approx(row) for row in expected]


def test_the_picture_says_what_is_predicted_and_why():
    assert draw_ranking(FULL).axes[0].get_title('left').startswith('the 1 selected of 3 sensors')
    decision = selection(replace(X, why='reward'), SCAN, STILL, target='decision')
    (axes,) = draw_ranking(decision).axes
    assert axes.texts[0].get_text() == 'p = 0.0012, reward'


def test_without_evidence_the_picture_shows_scores():
    (axes,) = draw_ranking(BARE).axes
    assert dots_of(axes) == [(0, 0.25), (1, 0.5), (2, -0.1)]
    assert legend_of(axes) == {'score'}


def dots_of(axes):
    lines = [line for line in axes.lines if line.get_marker() == 'o']
    return sorted((x, y) for line in lines for x, y in line.get_xydata().tolist())


def test_scores_are_drawn_in_their_null_band():
    (axes,) = draw_scores(FULL).axes
    assert dots_of(axes) == [(0, 0.25), (1, 0.5), (2, -0.1)]
    assert legend_of(axes) == {'null band: 5 % to 95 %', 'its median', 'score'}


def test_the_picture_of_scores_parts_the_selected_from_those_scored_beside_them():
    (axes,) = draw_scores(FULL).axes
    assert {text.get_text() for text in axes.texts} == {
        'selected: with those ranked before', 'others: with all selected ones',
    }  # fmt: skip
    for whole in (BARE, NOTHING):
        assert not draw_scores(whole).axes[0].texts
