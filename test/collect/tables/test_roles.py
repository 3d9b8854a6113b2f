# SPDX-License-Identifier: Apache-2.0

"""Tables of steps whose columns have names of the user's own."""

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import csv

from cmifs_ros.collect.outline import outline_of
from cmifs_ros.collect.pooling import pooled
from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import episodes_of_recording, recordings_in
from cmifs_ros.collect.tables.roles import Roles

ROLES = Roles('batch', reward='score', action=('heater', 'fan'), ignore=('t',))


def log(lengths=(4, 6, 5), seed=0):
    """Return a table of an oven's batches."""
    rng = np.random.default_rng(seed)
    count = sum(lengths)
    return pa.table(
        {
            'batch': np.repeat([f'B{i}' for i in range(len(lengths))], lengths),
            't': np.concatenate([np.arange(n) for n in lengths]),
            'temperature': rng.normal(size=count),
            'humidity': rng.uniform(size=count),
            'operator': ['ann'] * count,
            'heater': rng.integers(2, size=count),
            'fan': rng.choice([0.0, 0.5, 1.0], size=count),
            'score': rng.normal(size=count),
            'over': np.concatenate([np.arange(n) == n - 1 for n in lengths]),
            'stopped': np.zeros(count, bool),
        }
    )


def same(ours, theirs):
    pairs = zip(ours.episodes, theirs.episodes, strict=True)
    return all(
        np.array_equal(a.states, b.states)
        and np.array_equal(a.rewards, b.rewards)
        and np.array_equal(a.actions, b.actions)
        for a, b in pairs
    )


def test_columns_with_roles_give_the_episodes_of_a_table_with_the_names_of_lerobot():
    table = log()
    found = episodes_of_recording(table.drop(['over', 'stopped']), roles=ROLES)
    renamed = pa.table(
        {
            'episode_index': np.repeat([0, 1, 2], [4, 6, 5]),
            'observation.temperature': table['temperature'],
            'observation.humidity': table['humidity'],
            'action.heater': table['heater'],
            'action.fan': table['fan'],
            'next.reward': table['score'],
        }
    )
    assert found.channel_names == ('temperature', 'humidity')
    assert found.action_names == ('action_heater.0', 'action_heater.1', 'action_fan')
    assert same(found, episodes_of_recording(renamed))
    assert 'operator' in found.unreadable


@given(st.randoms(use_true_random=False))
def test_rows_of_episodes_may_be_mixed(random):
    table = log()
    ends = {'B0': 4, 'B1': 10, 'B2': 15}
    begins = {'B0': 0, 'B1': 4, 'B2': 10}
    left = [batch for batch in ends for _ in range(ends[batch] - begins[batch])]
    random.shuffle(left)
    rows, place = [], dict(begins)
    for batch in left:
        rows.append(place[batch])
        place[batch] += 1
    mixed = episodes_of_recording(table.take(rows), roles=ROLES)
    whole = episodes_of_recording(table, roles=ROLES)
    order = list(dict.fromkeys(left))
    for episode, batch in zip(mixed.episodes, order, strict=True):
        assert np.array_equal(episode.states, whole.episodes[int(batch[1])].states)


def test_numbers_of_episodes_that_begin_again_are_told():
    twice = pa.concat_tables([log([9, 8, 9]), log([8, 9, 10], seed=1)])
    found = episodes_of_recording(twice, roles=ROLES)
    (note,) = found.notes
    assert 'in 3 places: if the numbers in batch begin again' in note
    assert pooled([('oven.csv', outline_of(found))], None).notes == [f'oven.csv: {note}']
    # The rows of robots that run at the same time alternate.
    alternating = log([9, 9]).take(np.arange(18).reshape(2, 9).T.ravel())
    for table in (log(), alternating):
        assert episodes_of_recording(table, roles=ROLES).notes == ()


def test_a_true_value_in_any_of_the_columns_ends_an_episode():
    table = log()
    by_end = Roles(
        done=('over', 'stopped'), reward='score', action=('heater', 'fan'), ignore=('t',)
    )
    by_name = Roles(
        'batch', reward='score', action=('heater', 'fan'), ignore=('t', 'over', 'stopped')
    )
    assert same(
        episodes_of_recording(table, roles=by_end), episodes_of_recording(table, roles=by_name)
    )
    open_end = episodes_of_recording(table.slice(0, 12), roles=by_end)
    assert len(open_end.episodes) == 2
    assert open_end.num_open_steps == 2


def test_without_a_column_for_it_each_table_is_an_episode(tmp_path):
    csv.write_csv(log([7]), tmp_path / 'run.csv')
    found = episodes_of_recording(tmp_path / 'run.csv', roles=Roles(reward='score'))
    assert [len(episode) for episode in found.episodes] == [7]


def test_a_folder_of_tables_is_read_as_one_whose_files_are_its_episodes(tmp_path):
    # Alone, the first file would have no discrete action, and the second no gauge.
    rng = np.random.default_rng(0)
    for number, bins in {1: [2, 2, 2], 2: [0, 1, 2, 0], 10: [1, 1]}.items():
        count = len(bins)
        gauge = pa.nulls(count) if number == 2 else rng.normal(size=count)
        table = pa.table({'hue': rng.normal(size=count), 'gauge': gauge, 'bin': bins,
                          'won': np.arange(count) + number})  # fmt: skip
        csv.write_csv(table, tmp_path / f'try_{number}.csv')
    (tmp_path / 'try_11.csv').write_text('hue,gauge,bin,won\n')  # It has no step.
    roles = Roles(reward='won', action='bin', gaps='gauge')
    assert recordings_in(tmp_path, roles=roles) == [tmp_path]
    found = episodes_of_recording(tmp_path, roles=roles)
    assert found.channel_names == ('hue', 'gauge.value', 'gauge.seen')
    assert found.action_names == ('action_bin.0', 'action_bin.1', 'action_bin.2')
    assert [e.rewards.tolist() for e in found.episodes] == [[1, 2, 3], [2, 3, 4, 5], [10, 11]]
    assert found.episodes[1].states[:, 2].tolist() == [0, 0, 0, 0]
    assert '3 episodes of 9 steps; channels hue, gauge.value' in repr(found)


def test_episodes_of_a_folder_end_with_their_file(tmp_path):
    table = log()
    csv.write_csv(table.slice(0, 10), tmp_path / 'a.csv')
    csv.write_csv(table.slice(6, 9), tmp_path / 'b.csv')  # B1 is cut, and begins again
    found = episodes_of_recording(tmp_path, roles=ROLES)
    assert [len(episode) for episode in found.episodes] == [4, 6, 4, 5]
    assert recordings_in(tmp_path, roles=ROLES) == [tmp_path / 'a.csv', tmp_path / 'b.csv']


def test_a_sensor_with_gaps_holds_its_last_value_and_says_whether_there_is_one():
    nan = np.nan
    table = pa.table({
        'run': [0, 0, 0, 0, 1, 1, 1], 'x': np.arange(7.0),
        'tag': [nan, 5.0, nan, 7.0, nan, nan, 8.0],
        'pose': pa.array([[1, 2], [nan, 3], [4, 5], [nan, nan], [6, nan], [7, 8], [nan, 9]]),
    })  # fmt: skip
    found = episodes_of_recording(table, roles=Roles('run', gaps=('tag', 'pose')))
    assert found.channel_names == ('x', 'tag.value', 'tag.seen', 'pose[0]', 'pose[1]', 'pose.seen')
    first, second = (episode.states[:, 1:] for episode in found.episodes)
    assert first.tolist() == [
        [0, 0, 1, 2, 1], [5, 1, 1, 2, 0], [5, 0, 4, 5, 1], [7, 1, 4, 5, 0],
    ]  # fmt: skip
    assert second.tolist() == [[0, 0, 0, 0, 0], [0, 0, 7, 8, 1], [8, 1, 7, 8, 0]]
    dropped = episodes_of_recording(table.drop(['pose']), roles=Roles('run')).dropped
    assert [*dropped.values()] == [2]
    assert '--gaps' in next(iter(dropped))


def test_a_table_without_a_reward_says_so():
    assert episodes_of_recording(log(), roles=Roles('batch')).no_rewards


@pytest.mark.parametrize(
    ('roles', 'said'),
    [
        (Roles('lot'), 'no column lot; expected'),
        (Roles('batch', reward='scor'), r"no column scor \(did you mean 'score'\?\)"),
        (Roles('batch', reward='operator'), 'operator: it holds string, not numbers'),
        (Roles('batch', ignore=('t', 'temperature', 'humidity', 'heater', 'fan', 'score', 'over',
                                'stopped')), 'no sensors'),
    ],
)  # fmt: skip
def test_a_column_that_does_not_fit_its_role_is_named(roles, said):
    with pytest.raises(RecordingError, match=said):
        episodes_of_recording(log(), roles=roles)


def test_a_row_without_an_episode_is_named():
    table = log()
    batches = table['batch'].to_pylist()
    batches[3] = None
    table = table.set_column(0, 'batch', pa.array(batches))
    with pytest.raises(RecordingError, match='row 3 has no batch'):
        episodes_of_recording(table, roles=ROLES)


def test_a_reading_out_of_range_is_the_greatest_or_least_and_other_gaps_drop_their_episode():
    table = log()
    heat = table['temperature'].to_numpy().copy()
    expected = heat.copy()
    heat[[0, 7]], heat[5] = np.inf, -np.inf  # in the first two of three batches
    heat[12] = np.nan  # in the third
    finite = heat[np.isfinite(heat)]
    expected[[0, 7]], expected[5] = finite.max(), finite.min()
    table = table.set_column(table.column_names.index('temperature'), 'temperature', [heat])
    found = episodes_of_recording(table, roles=ROLES)
    column = found.channel_names.index('temperature')
    seen = np.concatenate([episode.states[:, column] for episode in found.episodes])
    np.testing.assert_array_equal(seen, expected[:10])
    ((cause, count),) = found.dropped.items()
    assert cause.startswith('episodes in which temperature is not a finite number')
    assert count == 1


def test_a_column_has_one_role():
    with pytest.raises(ValueError, match='score has two roles'):
        Roles('batch', reward='score', action=('score',))
    with pytest.raises(ValueError, match='either episode or done'):
        Roles('batch', done=('over',))


def test_a_single_column_may_be_given_by_its_name():
    alone = Roles('batch', reward='score', action='heater', ignore='t')
    assert alone == Roles('batch', reward='score', action=['heater'], ignore=('t',))
    names = episodes_of_recording(log(), roles=alone).action_names
    assert names == ('action_heater.0', 'action_heater.1')


@pytest.mark.parametrize('way', ['frame', 'parquet', 'csv'])
def test_the_index_of_a_data_frame_is_no_sensor(way, tmp_path):
    pandas = pytest.importorskip('pandas', reason='pandas is not here')
    parts = [log(seed=seed).to_pandas().assign(day=seed) for seed in range(2)]
    frame = pandas.concat(parts)  # its index begins anew
    frame['batch'] = frame['day'].astype(str) + frame['batch']
    if way != 'frame':
        path = tmp_path / f'oven.{way}'
        getattr(frame, f'to_{way}')(path)
        frame = path
    found = episodes_of_recording(frame, roles=ROLES)
    assert found.channel_names == ('temperature', 'humidity', 'over', 'stopped', 'day')
    assert len(found.episodes) == 6


def test_a_column_names_the_source_of_an_episode():
    table = log().append_column('oven', [['A'] * 4 + ['B'] * 11])
    roles = Roles('batch', reward='score', source='oven')
    found = episodes_of_recording(table, roles=roles)
    assert [episode.source for episode in found.episodes] == ['A', 'B', 'B']
    assert 'oven' not in found.channel_names
    mixed = log().append_column('oven', [['A'] * 5 + ['B'] * 10])
    with pytest.raises(RecordingError, match='batch B1 has rows of A, B in the column oven'):
        episodes_of_recording(mixed, roles=roles)


def test_only_tables_have_roles(tmp_path):
    (tmp_path / 'run.mcap').write_bytes(b'a')
    with pytest.raises(RecordingError, match='not a table'):
        episodes_of_recording(tmp_path / 'run.mcap', roles=ROLES)
