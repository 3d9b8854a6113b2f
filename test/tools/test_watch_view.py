import io
import re

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from cmifs_ros.tools.watch_view import Snapshot, Status, by_sensor, view

SELECTION = {
    'names': 'x, y',
    'age in s': '75',
    'cause': 'timer',
    'episodes used': '100',
    'seconds taken': '1.25',
    'worker': 'computing',
    'computing for s': '2.5',
    'progress': '40%',
    'statuses': 'x confirmed, y tentative, battery rejected',
    'pvalues': 'x 0.0021, y 0.2, battery 0.9',
}


def text_of(snapshot, width=80, **options):
    console = Console(file=io.StringIO(), width=width)
    console.print(view(snapshot, **options))
    return console.file.getvalue()


def snapshot(level=0, message='selected x, y', values=SELECTION, **other):
    known = {
        'ranking': ['x', 'y', 'battery'],
        'scores': [0.25, 1.0, 0.5],
        'statuses': {
            'input': Status(0, 'collecting', {'episodes': '120', 'messages dropped: late': '3'}),
            'selection': Status(level, message, values),
        },
    }
    return Snapshot('robot1/selector', **(known | other))


def test_the_view_shows_input_selection_evidence_and_cost_within_80_columns():
    text = text_of(snapshot())
    assert max(map(len, text.splitlines())) <= 80
    for shown in ('/robot1/selector', '120 episodes', 'messages dropped: late: 3',
                  'made 1 min ago (timer), from',
                  '100 episodes in 1.25 s', 'computing for 2.5 s, 40% done'):  # fmt: skip
        assert shown in ' '.join(text.split()), shown
    rows = {
        m[1]: m for m in re.finditer(r'^\d +(\w+) +([\d.]+) +(█*) +([\d.]+) +(\w+)', text, re.M)
    }
    assert [rows[n][2] for n in ('x', 'y', 'battery')] == ['0.250', '1.000', '0.500']
    assert len(rows['y'][3]) == 4 * len(rows['x'][3]) == 2 * len(rows['battery'][3])
    assert rows['y'][4] == '0.2'
    assert rows['battery'][5] == 'rejected'


def test_what_could_take_the_place_of_what_is_told():
    assert 'redundant' not in text_of(snapshot())
    text = text_of(snapshot(values=SELECTION | {'redundant': 'battery with x'}))
    assert 'redundant: battery with x' in text


def test_levels_are_told_by_words_not_by_colour_alone():
    for level, word in enumerate(('ok', 'warn', 'error', 'stale')):
        assert re.search(
            rf'^selection +{word} something', text_of(snapshot(level, 'something')), re.M
        )


def test_without_evidence_the_ranking_has_no_columns_for_it():
    text = text_of(snapshot(values={'names': 'x, y'}))
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
            1, 'of the last 9 steps, 9 lack battery: no message; they break episodes', {}
        ),
        '/odom': Status(0, 'received', {}),
        '/battery': Status(3, 'nobody publishes it', {}),
    }
    text = text_of(snapshot(sampler=sampler))
    assert re.search(r'^sampler +warn of the last 9 steps, 9 lack battery: no message', text, re.M)
    assert '/battery stale nobody publishes it' in text
    assert '/odom' not in text
    assert 'sampler' not in text_of(snapshot())
    assert re.search(
        r'^sampler +nothing heard for 60 s',
        text_of(snapshot(sampler=sampler, sampler_silence=60.0)), re.M,
    )  # fmt: skip


def test_long_names_are_shown_by_both_ends_and_push_no_column_away():
    names = [f'/front_lidar/scan/ranges/of_the_left_side[{i}]' for i in range(12)]
    values = SELECTION | {
        'statuses': ', '.join(f'{name} confirmed' for name in names),
        'pvalues': ', '.join(f'{name} 1.2e-18' for name in names),
    }
    text = text_of(snapshot(values=values, ranking=names, scores=[-0.125] * 12))
    assert max(map(len, text.splitlines())) <= 80
    rows = re.findall(r'^ *\d+ +/front_lid\S+…\S+(\[\d+\]) +-0.125 +1.2e-18 +confirmed', text, re.M)
    assert rows == [f'[{i}]' for i in range(12)]


def test_a_long_ranking_is_cut_and_says_so():
    many = snapshot(ranking=[f's{i}' for i in range(30)], scores=[0.1] * 30)
    assert 'and 25 more' in text_of(many, max_sensors=5)


def test_sensors_that_never_changed_have_no_score():
    text = text_of(snapshot(values=SELECTION | {'sensors that never changed': '1'}))
    assert 'battery' not in text
    assert '1 sensor never changed' in text


@given(
    st.lists(st.text(min_size=1, max_size=50), min_size=1, max_size=5),
    st.lists(st.floats(allow_nan=True), min_size=5, max_size=5),
    st.text(max_size=100),
)
def test_no_name_or_message_breaks_the_view_or_steers_the_terminal(names, scores, message):
    values = SELECTION | {'names': message, 'age in s': message, 'progress': message}
    text = text_of(snapshot(1, message, values, ranking=names, scores=scores[: len(names)]))
    assert all(c.isprintable() or c == '\n' for c in text)


def test_square_brackets_are_shown_and_not_taken_for_style():
    assert '[red]scan[0]' in text_of(snapshot(ranking=['[red]scan[0]'], scores=[1.0]))


names = st.lists(st.text('ab, ', min_size=1, max_size=6), min_size=1, max_size=8, unique=True)


@given(names)
def test_values_by_sensor_are_read_as_they_are_written(ranking):
    words = [f'v{i}' for i in range(len(ranking))]
    text = ', '.join(f'{n} {w}' for n, w in zip(ranking, words, strict=True))
    assert by_sensor(ranking, text) == dict(zip(ranking, words, strict=True))
