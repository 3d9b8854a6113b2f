# SPDX-License-Identifier: Apache-2.0

"""Tables whose rows are messages: a bag, its tables and its HDF5 file have the same episodes."""

from random import Random

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
import pyarrow as pa
from hypothesis import given, settings
from hypothesis import strategies as st
from pyarrow import csv, parquet
from streams import ROBOTS, STATUS, arrivals, as_message, collected, streams

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import (
    episodes_of_recording,
    recordings_in,
    robot_file_of_recording,
)
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.bag_reader import messages_of, open_bag


def content_of(recorded):
    parts = [
        (e.states.tobytes(), e.rewards.tobytes(), e.actions.tobytes(), s.tobytes())
        for e, s in zip(recorded.episodes, recorded.stamps, strict=True)
    ]
    return parts, recorded.channel_names, dict(recorded.dropped)


def flat(message, start=''):
    """Return the fields of a message of rosbags, with dots between."""
    found = {}
    for name in vars(message):
        value = getattr(message, name)
        if hasattr(value, '__msgtype__'):
            found |= flat(value, f'{start}{name}.')
        elif not name.startswith('_'):
            found[start + name] = value.tolist() if isinstance(value, np.ndarray) else value
    return found


@pytest.fixture
def bag(tmp_path):
    """Return a bag's path, the rows of its topics, and a robot file for it."""
    pytest.importorskip('rosbags', reason='rosbags is not here')
    from bags import ROBOT_OF_ALL, write_bag

    write_bag(tmp_path / 'bag')
    rows = {}
    with open_bag(tmp_path / 'bag') as reader:
        for topic, message, recorded in messages_of(reader, 'bag', reader.topics):
            rows.setdefault(topic[1:], []).append({'timestamp_ns': recorded, **flat(message)})
    return tmp_path / 'bag', rows, ROBOT_OF_ALL


def write_parquet(folder, rows):
    folder.mkdir()
    for topic, of_topic in rows.items():
        parquet.write_table(pa.Table.from_pylist(of_topic), folder / f'{topic}.parquet')


def write_hdf5(path, rows):
    from h5py import File

    with File(path, 'w') as file:
        for topic, of_topic in rows.items():
            for name in of_topic[0]:
                file[f'{topic}/{name.replace(".", "/")}'] = [row[name] for row in of_topic]
    return path


def test_a_bag_and_its_parquet_files_have_the_same_episodes(bag, tmp_path):
    path, rows, text = bag
    write_parquet(tmp_path / 'run', rows)
    robot = parse_robot_file(text)
    found = episodes_of_recording(tmp_path / 'run', robot)
    assert content_of(found) == content_of(episodes_of_bag(path, robot))
    assert len(found.episodes) == 25
    # Steps at 0.1 s for 15 s.
    assert found.traffic.messages['/pose'] == 151
    assert found.traffic.seconds == pytest.approx(15.0, abs=0.01)
    assert recordings_in(tmp_path / 'run', robot) == [tmp_path / 'run']


def test_a_bag_and_its_csv_files_have_the_same_episodes(bag, tmp_path):
    path, rows, text = bag
    (tmp_path / 'run').mkdir()
    for topic in ('pose', 'noise', 'pay'):
        table = pa.Table.from_pylist(rows[topic])
        csv.write_csv(table, tmp_path / 'run' / f'{topic}.csv')
    lines = [line for line in text.splitlines() if 'ray:' not in line and 'arm:' not in line]
    robot = parse_robot_file('\n'.join(lines))
    found = episodes_of_recording(tmp_path / 'run', robot)
    assert content_of(found) == content_of(episodes_of_bag(path, robot))


def test_a_bag_and_its_hdf5_file_have_the_same_episodes(bag, tmp_path):
    pytest.importorskip('h5py', reason='h5py is not here')
    path, rows, text = bag
    write_hdf5(tmp_path / 'run.hdf5', rows)
    robot = parse_robot_file(text)
    found = episodes_of_recording(tmp_path / 'run.hdf5', robot)
    assert content_of(found) == content_of(episodes_of_bag(path, robot))


def channels_of(text):
    """Return the lines of a robot file that are channels, or could be."""
    lines = text.partition('channels:\n')[2].partition('\n\n')[0].splitlines()
    return {line for line in lines if line.startswith('  ')}


@pytest.mark.parametrize('kind', ['parquet', 'hdf5'])
def test_the_first_robot_file_has_the_channels_of_the_bag(bag, tmp_path, kind):
    path, rows, _ = bag
    source = tmp_path / 'run'
    if kind == 'parquet':
        write_parquet(source, rows)
    else:
        pytest.importorskip('h5py', reason='h5py is not here')
        source = write_hdf5(tmp_path / 'run.hdf5', rows)
    expected = channels_of(robot_file_of_recording(path))
    assert channels_of(robot_file_of_recording(source)) == expected
    assert '  pose_x: "/pose.pose.position.x"' in expected


@settings(max_examples=25, deadline=None)
@given(streams(is_set_back=False), st.sampled_from(ROBOTS), st.integers(0, 2**32))
def test_tables_and_live_messages_have_the_same_episodes(sent, robot, seed):
    arrived = arrivals(sent, robot.topics, Random(seed))
    rows = {topic: [] for topic in robot.topics}
    for received, topic, message in arrived:
        content = as_message(topic, message)
        row = {'timestamp_ns': received, **vars(content)}
        if topic == STATUS:
            goals = [{'status': g.status, 'goal_info': {'goal_id': vars(g.goal_info.goal_id)}}
                     for g in content.status_list]  # fmt: skip
            row['status_list'] = goals
        elif message.stamp is not None:
            row['header'] = {'stamp': vars(content.header.stamp)}
        rows[topic].append(row)
    tables = {topic: pa.Table.from_pylist(of_topic) for topic, of_topic in rows.items()}
    expected = collected(robot, arrived, max_lateness=None)
    found = episodes_of_recording(tables, robot)
    contents = [(e.states.tobytes(), e.rewards.tobytes(), e.actions.tobytes())
                for e in found.episodes]  # fmt: skip
    assert contents == expected.episodes


WIDE = parse_robot_file(
    'step: {rate: 10.0}\nchannels: {x: /run.x, slow: {path: /run.slow, max_age: 5.0}}\n'
    'reward: x\nepisode: {steps: 4}\n'
)


def wide(pandas, num_rows=100):
    """Return a frame of ten rows a second, of which each twentieth has a value of `slow`."""
    numbers = np.arange(num_rows, dtype=float)
    slow = np.where(numbers % 20 == 0, numbers, np.nan)
    return pandas.DataFrame({'timestamp': numbers / 10, 'x': numbers, 'slow': slow})


@pytest.mark.parametrize('times', ['seconds', 'dates', 'whole seconds'])
def test_a_single_frame_is_the_topic_whatever_it_is_called(times):
    pandas = pytest.importorskip('pandas', reason='pandas is not here')
    frame = wide(pandas)
    if times == 'dates':
        frame['timestamp'] = pandas.Timestamp('2026-01-01') + pandas.to_timedelta(
            frame['timestamp'], unit='s'
        )
    elif times == 'whole seconds':
        frame['timestamp'] = np.arange(len(frame))
    robot = WIDE
    if times == 'whole seconds':
        robot = parse_robot_file(
            'step: {rate: 1.0}\nchannels: {x: {path: /run.x, max_age: 9.0}, '
            'slow: {path: /run.slow, max_age: 50.0}}\nreward: x\nepisode: {steps: 4}\n'
        )
    found = episodes_of_recording(frame, robot)
    # An empty cell is no message of this field: what was said before stays.
    for episode in found.episodes:
        np.testing.assert_array_equal(episode.states[:, 1], episode.states[:, 0] // 20 * 20)
    # Steps 0 to 3 and what step 3 reaches, then the next episode.
    assert [e.states[0, 0] for e in found.episodes[:3]] == [0.0, 5.0, 10.0]
    assert not found.dropped


def test_the_first_robot_file_of_a_wide_table(tmp_path):
    count = np.arange(2000)
    table = pa.table({
        'timestamp': count / 10,
        'slip': np.random.default_rng(0).normal(size=2000),
        'battery': [float(i) if i % 20 == 0 else None for i in count],
        'mode': np.where(count // 100 % 2, 'idle', 'lift'),
        'pallet': count // 50 % 4,
    })  # fmt: skip
    csv.write_csv(table, tmp_path / 'drive.csv')
    robot = robot_file_of_recording(tmp_path / 'drive.csv')
    one_hot = '{path: "/drive.pallet", one_hot: [0, 1, 2, 3]}'
    assert channels_of(robot) == {
        '  drive_slip: "/drive.slip"',
        # A value each 2 s.
        '  drive_battery: {path: "/drive.battery", max_age: 6.0}',
        '  # drive_mode: {path: "/drive.mode", one_hot: [lift, idle]}  # text; values seen',
        f'  drive_pallet: "/drive.pallet"  # if 0, 1, 2, 3 are categories: {one_hot}',
    }
    parse_robot_file(f'{robot}\nreward: "1"\n')


def test_rows_in_any_order_are_sorted_by_their_time(tmp_path):
    pandas = pytest.importorskip('pandas', reason='pandas is not here')
    frame = wide(pandas)
    mixed = frame.sample(frac=1, random_state=0)
    expected, found = (content_of(episodes_of_recording(f, WIDE)) for f in (frame, mixed))
    assert found == expected


@pytest.mark.parametrize(
    ('columns', 'said'),
    [
        ({'x': [1.0]}, 'has no column timestamp (seconds or dates), timestamp_ns or '
         'header.stamp.sec, for the time of a row'),
        ({'timestamp': [0.0, None], 'x': [1.0, 2.0]}, 'has no time in row 1'),
        ({'timestamp_ns': [5, None], 'x': [1.0, 2.0]}, 'has no time in row 1'),
        ({'header.stamp.sec': [None, 5], 'header.stamp.nanosec': [1, 2], 'x': [1.0, 2.0]},
         'has no time in row 0'),
        *(
            ({column: [kind(0), kind(time)], 'x': [1.0, 2.0], **more},
             f'{column} is {kind(time)} in row 1; expected at most {most}: timestamp is in '
             'seconds, timestamp_ns in nanoseconds')
            for kind in (int, float)
            for column, time, most, more in (
                ('timestamp', 1_790_000_000_000_000, '9e+09', {}),
                ('timestamp', 1_790_000_000_000_000_000, '9e+09', {}),
                ('timestamp_ns', 2**63 - 2**20, '9e+18', {}),
                ('header.stamp.sec', 10**18, '9e+09', {'header.stamp.nanosec': [0, 0]}),
            )
        ),
        ({'timestamp': ['soon'], 'x': [1.0]}, 'the times are object; expected numbers or dates'),
        ({'timestamp': [0.0], 'x': [1.0], 'x.y': [1.0]}, "has a column 'x.y' and another one "
         'that begins with it'),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_used_is_one_sentence(tmp_path, columns, said):
    parquet.write_table(pa.table(columns), tmp_path / 'run.parquet')
    with pytest.raises(RecordingError) as error:
        episodes_of_recording(tmp_path / 'run.parquet', WIDE)
    assert said in str(error.value)


def test_a_table_without_rows_is_a_topic_without_messages(tmp_path):
    (tmp_path / 'odom.csv').write_text('timestamp,x\n')
    with pytest.raises(RecordingError, match=r'no readable message, .*; /odom has no messages'):
        robot_file_of_recording(tmp_path / 'odom.csv')


def test_a_column_that_a_table_lacks_is_named():
    found = episodes_of_recording(pa.table({'timestamp': [0.0, 0.1], 'y': [1.0, 2.0]}), WIDE)
    (said,) = (cause for cause in found.dropped if 'wrong messages' in cause)
    assert "/run has no field 'slow'; expected one of timestamp, y" in said


def test_what_the_sampler_explains_is_not_counted_again():
    robot = parse_robot_file(
        'step: {topic: /a}\nchannels: {x: /a.x, y: {path: /b.y, max_age: 0.3}}\nreward: x\n'
        'episode: {terminated: "x == 3"}\n'
    )
    rows = np.arange(24)
    # y is silent in the middle of an episode, and at the beginning of the unfinished last one.
    heard = rows[((rows < 6) | (rows > 12)) & ((rows < 17) | (rows > 21))]
    x = np.where(np.isin(rows, [2, 19]), 3.0, 0.0)
    a = pa.table({'timestamp': rows / 10 + 0.001, 'x': x})
    b = pa.table({'timestamp': heard / 10, 'y': np.ones(len(heard))})
    found = episodes_of_recording({'a': a, 'b': b}, robot)
    of_episodes = {cause: n for cause, n in found.dropped.items() if cause.startswith('episodes')}
    assert of_episodes == {
        'episodes that ended by `terminated`: a step lacks y; 1 of 2 are left': 1,
        'episodes: an episode whose beginning was not seen (joined_midway)': 1,
    }


def test_a_table_that_the_robot_file_names_and_is_not_there_is_named(tmp_path):
    for name in ('one', 'two'):
        table = pa.table({'timestamp': [0.0], 'x': [1.0]})
        parquet.write_table(table, tmp_path / f'{name}.parquet')
    with pytest.raises(RecordingError, match=r'lacks /run of the robot file; it has /one, /two'):
        episodes_of_recording(tmp_path, WIDE)


def test_two_tables_that_are_the_same_topic_are_named(tmp_path):
    table = pa.table({'timestamp': [0.0], 'x': [1.0], 'slow': [1.0]})
    parquet.write_table(table, tmp_path / 'run.parquet')
    csv.write_csv(table, tmp_path / 'run.csv')
    with pytest.raises(RecordingError, match=r'run.csv and .*run.parquet are both the topic /run'):
        episodes_of_recording(tmp_path, WIDE)
    with pytest.raises(RecordingError, match=r'run and /run are both the topic /run; expected one'):
        episodes_of_recording({'run': table, '/run': table}, WIDE)


def test_what_is_no_recording_is_one_sentence(tmp_path):
    (tmp_path / 'page.html').write_text('<p>')
    for path in (tmp_path, tmp_path / 'page.html'):
        for robot in (None, WIDE):
            with pytest.raises(RecordingError, match='is not a recording; expected a bag'):
                episodes_of_recording(path, robot)
    for name in ('a.mcap', 'a.db3', 'a.bag', 'a.parquet', 'a.csv', 'a.h5', 'a.ulg'):
        (tmp_path / name).touch()
        with pytest.raises(RecordingError, match=rf'{name} is empty$'):
            episodes_of_recording(tmp_path / name, WIDE)
        with pytest.raises(RecordingError, match=rf'{name} is empty$'):
            robot_file_of_recording(tmp_path / name)
    (tmp_path / 'torn.parquet').write_bytes(b'PAR1')
    with pytest.raises(RecordingError, match='cannot be read as parquet'):
        episodes_of_recording(tmp_path / 'torn.parquet')
    with pytest.raises(RecordingError, match='int is not a data frame'):
        episodes_of_recording(3)
