# SPDX-License-Identifier: Apache-2.0

"""Tables of steps: LeRobot's folders of v2.1 and v3, and others with such columns."""

import json

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
import pyarrow as pa
from pyarrow import csv, parquet

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import (
    episodes_of_recording,
    recordings_in,
    robot_file_of_recording,
)

LENGTHS = (5, 3, 6)


def rows(seed=0, lengths=LENGTHS, **columns):
    """Return LeRobot's columns of some episodes; more of them, or others, by name."""
    rng = np.random.default_rng(seed)
    frames = np.concatenate([np.arange(n) for n in lengths])
    numbers = np.repeat(np.arange(len(lengths)), lengths)
    last = np.append(np.diff(numbers) > 0, True)
    count = len(frames)
    found = {
        'observation.state': rng.normal(size=(count, 2)).astype(np.float32),
        'observation.environment_state': rng.normal(size=(count, 3)).astype(np.float32),
        'action': rng.normal(size=(count, 2)).astype(np.float32),
        'next.reward': rng.normal(size=count).astype(np.float32),
        'next.done': last,
        'next.success': last & (numbers != 1),
        'timestamp': (frames / 50).astype(np.float32),
        'frame_index': frames,
        'episode_index': numbers,
        'index': np.arange(count),
        'task_index': np.zeros(count, int),
    }
    return {key: values for key, values in (found | columns).items() if values is not None}


def table_of(columns, which=slice(None)):
    return pa.table({key: list(values[which]) for key, values in columns.items()})


def write(folder, columns, version, names=('x', 'y')):
    """Write a data set's folder as LeRobot does: a file for each episode, or for many."""
    features = {key: {'dtype': 'float32', 'names': None} for key in columns}
    features['observation.state'] = {'dtype': 'float32', 'names': names}
    features['action'] = {'dtype': 'float32', 'names': {'motors': ['x', 'y']}}
    features['observation.images.wrist'] = {'dtype': 'image', 'names': ['height', 'width', 'rgb']}
    numbers = columns['episode_index']
    if version == 'v2.1':
        files = {f'episode_{n:06d}': numbers == n for n in np.unique(numbers)}
    else:
        files = {'file-000': numbers < 2, 'file-001': numbers >= 2}
        (folder / 'meta/episodes').mkdir(parents=True)
        parquet.write_table(pa.table({'length': LENGTHS}), folder / 'meta/episodes/file.parquet')
    (folder / 'data/chunk-000').mkdir(parents=True)
    for name, which in files.items():
        parquet.write_table(table_of(columns, which), folder / f'data/chunk-000/{name}.parquet')
    (folder / 'meta').mkdir(exist_ok=True)
    about = {'codebase_version': version, 'fps': 50, 'features': features}
    (folder / 'meta/info.json').write_text(json.dumps(about))
    return folder


def assert_episodes(found, columns, rewards=None):
    """Check states, actions and rewards against the columns as they were made."""
    rewards = columns['next.reward'] if rewards is None else rewards
    expected = np.cumsum((0, *LENGTHS))
    assert [len(episode) for episode in found.episodes] == list(LENGTHS)
    states = np.hstack([columns['observation.state'], columns['observation.environment_state']])
    for episode, begin, end in zip(found.episodes, expected[:-1], expected[1:], strict=True):
        np.testing.assert_array_equal(episode.states, states[begin:end])
        np.testing.assert_array_equal(episode.actions, columns['action'][begin:end])
        np.testing.assert_array_equal(episode.rewards, rewards[begin:end])


@pytest.mark.parametrize('version', ['v2.1', 'v3.0'])
def test_a_folder_of_lerobot(tmp_path, version):
    columns = rows()
    folder = write(tmp_path / 'set', columns, version)
    found = episodes_of_recording(folder)
    assert_episodes(found, columns)
    environment = tuple(f'environment_state[{i}]' for i in range(3))
    assert found.channel_names == ('x', 'y', *environment)
    assert found.action_names == ('action.x', 'action.y')
    assert found.step_seconds == pytest.approx(0.02)
    assert found.unreadable.keys() == {'observation.images.wrist'}
    assert 'has no column' in found.unreadable['observation.images.wrist']
    assert recordings_in(tmp_path) == recordings_in(folder) == [folder]


@pytest.mark.parametrize(
    ('names', 'expected'),
    [
        (None, ('state_0', 'state_1')),
        ({'axes': ['x', 'y']}, ('x', 'y')),
        ({'x': 0, 'y': 1}, ('x', 'y')),
        (['one', 'two', 'three'], ('state_0', 'state_1')),
    ],
)
def test_names_of_numbers_in_all_the_ways_in_which_they_are_written(tmp_path, names, expected):
    found = episodes_of_recording(write(tmp_path / 'set', rows(), 'v3.0', names))
    assert found.channel_names[:2] == expected


def test_without_a_reward_success_is_that_of_the_last_step(tmp_path):
    columns = rows(**{'next.reward': None})
    found = episodes_of_recording(table_of(columns))
    rewards = np.zeros(14)
    rewards[[4, 13]] = 1.0
    assert_episodes(found, columns, rewards)


def test_without_reward_and_success_there_is_none_and_it_is_told():
    columns = rows(**{'next.reward': None, 'next.success': None})
    found = episodes_of_recording(table_of(columns))
    assert_episodes(found, columns, np.zeros(14))
    assert found.no_rewards == 'no column next.reward or next.success'


def test_rows_in_any_order_are_sorted_and_the_done_of_the_last_ends_an_episode(tmp_path):
    columns = rows()
    order = np.random.default_rng(1).permutation(14)
    assert_episodes(episodes_of_recording(table_of(columns, order)), columns)
    columns = rows(episode_index=None, frame_index=None)
    columns['next.done'][-1] = False
    found = episodes_of_recording(table_of(columns))
    assert [len(episode) for episode in found.episodes] == [5, 3]
    assert found.num_open_steps == 6


def test_csv_has_a_column_for_each_number(tmp_path):
    columns = rows()
    flat = {key: columns[key] for key in ('episode_index', 'next.reward')}
    flat |= {f'observation.{name}': columns['observation.state'][:, i]
             for i, name in enumerate('xy')}  # fmt: skip
    flat |= {'action.turn': columns['task_index'] + np.arange(14) % 2, 'note': ['go'] * 14}
    flat['observation.mode'] = ['idle'] * 14
    csv.write_csv(table_of({key: np.array(values) for key, values in flat.items()}),
                  tmp_path / 'run.csv')  # fmt: skip
    found = episodes_of_recording(tmp_path / 'run.csv')
    assert (found.channel_names, found.action_names) == (
        ('x', 'y'), ('action_turn.0', 'action_turn.1')
    )  # fmt: skip
    states = np.concatenate([episode.states for episode in found.episodes])
    np.testing.assert_array_equal(states.astype(np.float32), columns['observation.state'])
    actions = np.concatenate([episode.actions for episode in found.episodes])
    np.testing.assert_array_equal(actions[:, 1], np.arange(14) % 2)
    assert found.unreadable == {'observation.mode': 'it holds string, not numbers'}


def test_a_frame_of_pandas():
    pandas = pytest.importorskip('pandas', reason='pandas is not here')
    columns = rows()
    found = episodes_of_recording(pandas.DataFrame({key: list(v) for key, v in columns.items()}))
    assert_episodes(found, columns)


def test_episodes_that_miss_a_step_or_a_number_are_dropped_and_counted():
    columns = rows()
    columns['observation.environment_state'][6, 2] = np.nan
    which = np.arange(14) != 10
    found = episodes_of_recording(table_of(columns, which))
    assert [len(episode) for episode in found.episodes] == [5]
    assert found.dropped == {
        'episodes of which frame_index misses a step': 1,
        'episodes in which environment_state[2] is not a finite number': 1,
    }


@pytest.mark.parametrize(
    ('columns', 'said'),
    [
        (rows(**{'observation.state': None, 'observation.environment_state': None}),
         'has the columns action, next.reward'),
        (rows(episode_index=None, **{'next.done': None}), 'expected observation.* of numbers and '
         'episode_index or next.done'),
        (rows(**{'observation.state': [[1.0, 2.0]] * 9 + [[1.0]] * 5}),
         'row 9 of observation.state has 1; expected 2 numbers, as row 0 has'),
        (rows(**{'observation.state': [None] + [[1.0, 2.0]] * 13}),
         'row 0 of observation.state has nothing; expected 2 numbers, as row 1 has'),
        (rows(episode_index=[0.0] * 13 + [None]), 'row 13 has no episode_index'),
        (rows(episode_index=None, **{'next.done': [None] + [True] * 13}),
         'row 0 has no next.done'),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_used_is_one_sentence(columns, said):
    table = pa.table({key: list(values) for key, values in columns.items()})
    with pytest.raises(RecordingError) as error:
        episodes_of_recording(table)
    assert said in str(error.value)


@pytest.mark.parametrize('empty', [[], None])
def test_a_column_of_empty_lists_is_left_out(empty):
    table = table_of(rows())
    lists = pa.array([empty] * len(table), pa.list_(pa.float32()))
    found = episodes_of_recording(table.append_column('observation.extra', lists))
    assert_episodes(found, rows())
    assert found.unreadable == {'observation.extra': 'its lists are empty'}


def test_a_table_without_rows_has_no_episode():
    with pytest.raises(RecordingError, match='has no complete episode'):
        episodes_of_recording(table_of(rows()).slice(0, 0))


def test_an_observation_and_its_state_are_both_read():
    rng, states = np.random.default_rng(3), rows()['observation.state']
    more, actions = rng.normal(size=(14, 1)), rng.normal(size=14)
    columns = rows(observation=more, **{'action.state': actions})
    found = episodes_of_recording(table_of(columns))
    read = np.vstack([episode.states for episode in found.episodes])
    expected = {'state_0': more[:, 0], 'state[1]': states[:, 1]}
    for name, values in expected.items():
        np.testing.assert_array_equal(read[:, found.channel_names.index(name)], values)
    assert set(found.action_names) == {'action_0', 'action_1', 'action_state'}


def test_a_folder_of_lerobot_needs_no_robot_file(tmp_path):
    folder = write(tmp_path / 'set', rows(), 'v3.0')
    with pytest.raises(RecordingError, match='is a data set of LeRobot; it needs no robot file'):
        robot_file_of_recording(folder)


@pytest.mark.parametrize('text', ['{', '{"fps": 50}', '[]'])
def test_a_description_that_cannot_be_read_is_named(tmp_path, text):
    folder = write(tmp_path / 'set', rows(), 'v3.0')
    (folder / 'meta/info.json').write_text(text)
    with pytest.raises(RecordingError, match=r'info.json cannot be read .* with features'):
        episodes_of_recording(folder)
