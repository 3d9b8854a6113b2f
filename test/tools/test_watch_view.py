# SPDX-License-Identifier: Apache-2.0

import io
import re
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from selections import selection, sensor

from cmifs_ros.collect.advice import advice_of
from cmifs_ros.collect.traffic import Rate
from cmifs_ros.core.effect import Effect
from cmifs_ros.tools.ranking import further_columns
from cmifs_ros.tools.watch_view import Snapshot, Status, view

VALUES = {
    'names': 'x, y',
    'age in s': '75',
    'cause': 'timer',
    'episodes used': '100',
    'seconds taken': '1.25',
    'worker': 'computing',
    'computing for s': '2.5',
    'progress': '40%',
}
X = sensor('x', 0.25, is_selected=True, pvalue=0.0021, status='confirmed', effect=Effect(0.4, 0.1))
Y = sensor('y', 1.0, is_selected=True, pvalue=0.2)
BATTERY = sensor('battery', 0.5, pvalue=0.9, status='dispensable', effect=Effect(-0.001, 0.002))


SAMPLER = {'steps': Status(0, 'steps are made', {'steps': '12', 'steps per s': '4.0'})}


def text_of(snapshot, width=80, **options):
    console = Console(file=io.StringIO(), width=width)
    console.print(view(snapshot, console, **options))
    return console.file.getvalue()


def snapshot(*sensors, level=0, message='selected x, y', values=VALUES, **other):
    statuses = {
        'input': Status(0, 'collecting', {'episodes': '120', 'messages dropped: late': '3'}),
        'selection': Status(level, message, values),
    }
    known = {'selection': selection(*(sensors or (X, Y, BATTERY))), 'statuses': statuses}
    return Snapshot('robot1/selector', **(known | other))


def test_the_view_shows_input_selection_evidence_and_cost_within_80_columns():
    text = text_of(snapshot())
    assert max(map(len, text.splitlines())) <= 80
    for shown in ('/robot1/selector', '120 episodes', 'messages dropped: late: 3',
                  'made 1 min ago (timer), from', 'undecided: y (wide interval)',
                  '100 episodes in 1.25 s', 'computing for 2.5 s, 40% done'):  # fmt: skip
        assert shown in ' '.join(text.split()), shown
    rows = re.findall(r'^ +\d +(\w+) +(\S+%) +(below \S+|\S+% to \S+%) +(\w+) +(\S+)$', text, re.M)
    assert rows == [
        ('x', '40.0%', '20.4% to 59.6%', 'confirmed', '0.0021'),
        ('y', '12.5%', '0.3% to 24.7%', 'undecided', '0.2'),
        ('battery', '-0.1%', 'below 0.3%', 'dispensable', '0.9'),
    ]


def test_warnings_come_first_and_the_share_that_is_predicted_is_said():
    found = selection(
        replace(X, why='reward'), replace(Y, why='predicts x'), BATTERY, target='decision',
        warnings=('the episodes overlap',), predicted_share=0.5, predicted_share_of_all=0.25,
    )  # fmt: skip
    text = text_of(snapshot(selection=found))
    assert text.index('warning the episodes overlap') < text.index('input')
    text = ' '.join(text.split())
    assert 'the 2 selected of 3 sensors predict 50% of the variance of the reward' in text
    assert 'why: x (reward), y (predicts x -> reward)' in text


def test_redundant_sensors_are_named():
    assert 'redundant' not in text_of(snapshot())
    text = text_of(snapshot(X, Y, replace(BATTERY, redundant_with=('x',))))
    assert 'redundant: battery with x' in text


def test_a_selection_that_cannot_be_read_is_said_to_be():
    text = text_of(snapshot(selection=None, unreadable="ValueError('a selection of version 2')"))
    text = ' '.join(text.split())
    assert "the selection cannot be read: ValueError('a selection of version 2')" in text


def test_levels_are_told_by_words_not_by_colour_alone():
    for level, word in enumerate(('ok', 'warn', 'error', 'stale')):
        assert re.search(
            rf'^selection +{word} something',
            text_of(snapshot(level=level, message='something')),
            re.M,
        )


def test_without_evidence_the_ranking_has_no_columns_for_it():
    text = text_of(snapshot(sensor('x', 0.25, is_selected=True)))
    assert '0.250' in text
    assert 'status' not in text


def test_a_selector_that_fell_silent_is_said_to_be():
    assert 'nothing heard' not in text_of(snapshot(silence=1.0))
    assert 'nothing heard for 60 s' in text_of(snapshot(silence=60.0))


def test_a_selector_in_another_namespace_is_pointed_at():
    assert 'watch --namespace /robot2' in text_of(Snapshot(elsewhere=['/robot2']))


def test_the_sampler_is_shown_with_the_topics_that_are_not_well():
    sampler = {
        'steps': Status(
            1,
            'of the last 9 steps, 9 lack battery: no message; this breaks episodes',
            {'steps': '12', 'steps per s': '4.0'},
        ),
        '/odom': Status(0, 'received', {}),
        '/battery': Status(3, 'nobody publishes it', {}),
    }
    text = text_of(snapshot(sampler=sampler))
    assert re.search(r'^sampler +warn of the last 9 steps, 9 lack battery: no message', text, re.M)
    assert '/battery stale nobody publishes it' in text
    assert '/odom' not in text
    assert 'sampler' not in text_of(snapshot())
    alone = text_of(Snapshot(sampler=sampler))
    assert 'no selector heard' in alone
    assert '9 lack battery' in alone
    assert '12 steps, 4.0 per s' in alone
    assert alone.index('/battery stale nobody publishes it') < alone.index('/odom ok received')
    assert re.search(
        r'^sampler +nothing heard for 60 s',
        text_of(snapshot(sampler=sampler, sampler_silence=60.0)), re.M,
    )  # fmt: skip


def test_what_saving_has_switched_off_and_saves_is_shown():
    values = {
        'messages saved': '1234', 'bytes saved': '5 kB', 'CPU with all topics': '9.0% of a core',
        'CPU while saving': '4.0% of a core', 'saved: /imu': '100 messages/s, 3 kB/s; so far 1',
    }  # fmt: skip
    saving = Status(0, 'switched off: /imu; on again after 7 episodes', values)
    lines = [
        ' '.join(line.split())
        for line in text_of(snapshot(sampler={'saving': saving})).splitlines()
    ]
    i = lines.index('sampler saving ok switched off: /imu; on again after 7 episodes')
    assert lines[i + 1 : i + 4] == [
        'saved so far: 1234 messages, 5 kB',
        '/imu 100 messages/s, 3 kB/s',
        'CPU: 9.0% of a core with all topics, 4.0% of a core while saving',
    ]
    begun = Status(0, 'all topics are on: none can go', {'messages saved': '0'})
    assert 'saved so far' not in text_of(snapshot(sampler={'saving': begun}))


def test_long_names_are_shown_by_both_ends_and_push_no_column_away():
    names = [f'/front_lidar/scan/ranges/of_the_left_side[{i}]' for i in range(12)]
    text = text_of(snapshot(*(sensor(n, pvalue=1.2e-18, status='confirmed') for n in names)))
    assert max(map(len, text.splitlines())) <= 80
    row = r'^ *\d+ +/front_lid\S+…\S+(\[\d+\]) +12.5% +0.3% to 24.7% +confirmed +1.2e-18$'
    rows = re.findall(row, text, re.M)
    assert rows == [f'[{i}]' for i in range(12)]


def test_a_long_ranking_is_cut_to_fit_and_says_so():
    many = snapshot(*(sensor(f's{i}', pvalue=0.5) for i in range(50)), sampler=SAMPLER)
    assert 'and 10 more' in text_of(many)
    for max_lines in (30, 50):
        text = text_of(many, max_lines=max_lines)
        assert max_lines - 3 <= len(text.splitlines()) <= max_lines
        assert re.search(r'^and \d+ more$', text, re.M)


def test_beside_a_sampler_it_ends_with_the_topics_that_can_go():
    topics = {'x': '/pose', 'y': '/pose', 'battery': '/battery'}
    advice = advice_of(selection(X, Y, BATTERY), topics, {'/battery': Rate(2.0, 160.0)})
    text = text_of(snapshot(advice=advice))
    assert text.endswith("""
This is about the return under the recorded controller. A controller that is to
be learned or changed may need other sensors: target decision.
keep these:
  /pose: x adds 40.0%, y adds 12.5%
these can go:
  /battery: battery adds at most 0.2%; 2 messages/s, 160 B/s
undecided: nothing
""")
    many = [sensor(f's{i}', pvalue=0.5) for i in range(30)]
    advice = advice_of(selection(*many), {one.name: f'/{one.name}' for one in many})
    assert '\n  and 18 more\n' in text_of(snapshot(*many, advice=advice))
    text = text_of(snapshot(*many, advice=advice), max_lines=40)
    assert len(text.splitlines()) <= 40
    assert re.search(r'^undecided:\n  /s0: s0 adds', text, re.M)


def test_sensors_that_never_changed_have_no_score():
    text = text_of(snapshot(X, Y, replace(BATTERY, is_constant=True)))
    assert 'battery' not in text
    assert '1 sensor constant' in text


@given(
    st.lists(st.text(min_size=1, max_size=50), min_size=1, max_size=5),
    st.lists(st.floats(allow_nan=True), min_size=5, max_size=5),
    st.text(max_size=100),
)
def test_no_name_or_message_breaks_the_view_or_steers_the_terminal(names, scores, message):
    values = VALUES | {'names': message, 'age in s': message, 'progress': message}
    sensors = [
        sensor(name, score, pvalue=abs(score), redundant_with=(message,))
        for name, score in zip(names, scores, strict=False)
    ]
    text = text_of(snapshot(*sensors, level=1, message=message, values=values, unreadable=message))
    assert all(c.isprintable() or c == '\n' for c in text)


def test_square_brackets_are_shown_and_not_taken_for_style():
    assert '[red]scan[0]' in text_of(snapshot(sensor('[red]scan[0]')))


def test_what_only_earlier_selections_confirmed_is_said():
    kept = replace(X, name='kept', pvalue=0.79)
    live = selection(X, kept, Y, level=0.003)
    text = ' '.join(text_of(snapshot(selection=live)).split())
    assert 'confirmed by earlier selections: kept ' in text
    (remarks,) = (c.cells for c in further_columns(live, most_names=3) if c.heading == 'why')
    assert remarks == ['', 'confirmed earlier', 'wide interval']
    of_bag = selection(X, Y, BATTERY)
    assert 'earlier' not in text_of(snapshot(selection=of_bag))
