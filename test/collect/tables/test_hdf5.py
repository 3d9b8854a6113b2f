# SPDX-License-Identifier: Apache-2.0

"""Data sets of steps in HDF5, in the shapes of Minari, robomimic, D4RL and ALOHA."""

import tracemalloc

import numpy as np
import pytest

pytest.importorskip('h5py', reason='h5py is not here')
import h5py

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import (
    episodes_of_recording,
    recordings_in,
    robot_file_of_recording,
)
from cmifs_ros.collect.robot_file.reader import parse_robot_file

RNG = np.random.default_rng(0)


def write(path, contents):
    """Write arrays by their paths."""
    with h5py.File(path, 'w') as file:
        for name, values in contents.items():
            file[name] = values
    return path


def minari(path, lengths, actions=lambda n: RNG.integers(0, 3, n)):
    """Write what Minari 0.5.4's DataCollector does; return states, actions and rewards."""
    contents, expected = {}, []
    for number, n in enumerate(lengths):
        states, acted, paid = RNG.normal(size=(n + 1, 4)), actions(n), RNG.normal(size=n)
        last = np.arange(n) == n - 1
        contents |= {
            f'episode_{number}/{key}': values
            for key, values in {
                'observations': states.astype(np.float32), 'actions': acted, 'rewards': paid,
                'terminations': last, 'truncations': ~last & False, 'infos/score': paid,
            }.items()
        }  # fmt: skip
        expected.append((states[:n].astype(np.float32), acted, paid))
    write(path, contents)
    return expected


def test_minari(tmp_path):
    path = tmp_path / 'data' / 'main_data.hdf5'
    path.parent.mkdir()
    # Beyond ten, as text the numbers are in another order.
    expected = minari(path, [3, 5, 4, 3, 6, 2, 3, 4, 5, 3, 7, 8])
    found = episodes_of_recording(path)
    assert found.channel_names == ('obs_0', 'obs_1', 'obs_2', 'obs_3')
    assert found.action_names == ('action.0', 'action.1', 'action.2')
    assert (found.num_read, found.unit, len(found.episodes)) == (53, 'step', 12)
    for episode, (states, actions, rewards) in zip(found.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.actions, np.eye(3)[actions])
        np.testing.assert_array_equal(episode.rewards, rewards)
    assert recordings_in(tmp_path) == [path]


def test_minari_of_a_dict_space_and_continuous_actions(tmp_path):
    contents = {}
    for number in range(2):
        contents |= {
            f'episode_{number}/observations/{key}': RNG.normal(size=(6, *shape))
            for key, shape in {'goal': (3,), 'speed': (1,), 'eye': (8, 8, 3)}.items()
        }
        contents[f'episode_{number}/actions'] = RNG.normal(size=(5, 2))
        contents[f'episode_{number}/rewards'] = RNG.normal(size=5)
    found = episodes_of_recording(write(tmp_path / 'main_data.hdf5', contents))
    assert found.channel_names == ('goal[0]', 'goal[1]', 'goal[2]', 'speed')
    assert found.action_names == ('action_0', 'action_1')
    assert found.unreadable == {'eye': 'images are not read'}
    states = np.hstack([contents[f'episode_1/observations/{key}'][:5] for key in ('goal', 'speed')])
    np.testing.assert_array_equal(found.episodes[1].states, states)


def test_robomimic(tmp_path):
    contents, expected = {'mask/train': [b'demo_0']}, []
    for number in (10, 2, 1):
        n = 4 + number
        eef, gripper = RNG.normal(size=(n, 3)), RNG.normal(size=(n, 1))
        actions, rewards = RNG.normal(size=(n, 7)), (np.arange(n) >= n - 2).astype(float)
        contents |= {
            f'data/demo_{number}/{key}': values
            for key, values in {
                'obs/robot0_eef_pos': eef, 'obs/gripper': gripper, 'actions': actions,
                'obs/wrist_image': np.zeros((n, 4, 4, 3), np.uint8), 'next_obs/gripper': gripper,
                # It is done at each step with success, not only at the last one.
                'rewards': rewards, 'dones': rewards.astype(int), 'states': RNG.normal(size=(n, 9)),
            }.items()
        }  # fmt: skip
        expected.insert(0, (np.hstack([gripper, eef]), actions, rewards))
    found = episodes_of_recording(write(tmp_path / 'demo.hdf5', contents))
    names = ('gripper', 'robot0_eef_pos[0]', 'robot0_eef_pos[1]', 'robot0_eef_pos[2]')
    assert found.channel_names == names
    assert found.action_names == tuple(f'action_{i}' for i in range(7))
    assert found.unreadable == {'wrist_image': 'images are not read'}
    for episode, (states, actions, rewards) in zip(found.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.actions, actions)
        np.testing.assert_array_equal(episode.rewards, rewards)


def test_d4rl_is_cut_at_its_ends(tmp_path):
    terminals, timeouts = np.zeros((2, 20), bool)
    terminals[4], timeouts[11] = True, True
    contents = {
        'observations': RNG.normal(size=(20, 2)), 'actions': RNG.normal(size=(20, 1)),
        'rewards': RNG.normal(size=20), 'terminals': terminals, 'timeouts': timeouts,
        'infos/qpos': RNG.normal(size=(20, 2)),
    }  # fmt: skip
    found = episodes_of_recording(write(tmp_path / 'walk.hdf5', contents))
    assert [len(episode) for episode in found.episodes] == [5, 7]
    assert found.num_open_steps == 8
    np.testing.assert_array_equal(found.episodes[1].states, contents['observations'][5:12])
    np.testing.assert_array_equal(found.episodes[1].rewards, contents['rewards'][5:12])


def test_marks_of_ends_that_are_never_true_leave_no_complete_episode(tmp_path):
    contents = {'observations': RNG.normal(size=(9, 2)), 'terminals': np.zeros(9, bool)}
    with pytest.raises(RecordingError, match='has no complete episode'):
        episodes_of_recording(write(tmp_path / 'walk.hdf5', contents))


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'timeouts': np.zeros(8, bool)}, 'has 9 steps, but timeouts 8; expected as many'),
        ({'terminals': True}, '/terminals is no array; expected a number for each step'),
        ({'rewards': 1.0}, '/rewards is no array; expected a number for each step'),
        ({'rewards/task': np.zeros(9)}, '/rewards is no array; expected a number for each step'),
    ],
)
def test_marks_and_rewards_that_are_no_number_for_each_step_are_named(tmp_path, change, said):
    contents = {'observations': RNG.normal(size=(9, 2)), 'terminals': np.arange(9) == 8} | change
    with pytest.raises(RecordingError) as error:
        episodes_of_recording(write(tmp_path / 'walk.hdf5', contents))
    assert said in str(error.value)


def test_aloha_has_an_episode_in_each_file_and_no_reward(tmp_path):
    for number in (0, 1, 10, 2):
        contents = {
            'observations/qpos': RNG.normal(size=(6, 14)), 'action': RNG.normal(size=(6, 14)),
            'observations/images/top': np.zeros((6, 5, 5, 3), np.uint8),
            # Compressed pictures, filled up to the same number of bytes.
            'observations/images/wrist': np.zeros((6, 70), np.uint8),
            'observations/eye': np.zeros((6, 4000), np.uint8),
            'observations/touch': np.zeros((6, 2), np.uint8),
        }  # fmt: skip
        write(tmp_path / f'episode_{number}.hdf5', contents)
    paths = recordings_in(tmp_path)
    assert [path.stem[8:] for path in paths] == ['0', '1', '2', '10']
    found = episodes_of_recording(paths[0])
    assert (len(found.episodes), found.channel_names[13]) == (1, 'qpos[13]')
    assert found.channel_names[14:] == ('touch[0]', 'touch[1]')
    assert found.unreadable == dict.fromkeys(
        ('eye', 'images.top', 'images.wrist'), 'images are not read'
    )
    assert found.no_rewards == 'no data set rewards or reward'
    assert not found.episodes[0].rewards.any()


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'episode_1/observations': np.zeros((9, 4))}, 'episode_1 has 5 steps by its action, but '
         'state 9; expected the same number of each, or one state more'),
        ({'episode_1/rewards': np.zeros(4)}, 'episode_1 has 5 steps by its action, but rewards 4'),
        ({'episode_1/observations': np.zeros((6, 3))}, 'episode_1 has states of 3 numbers; '
         'expected 4 numbers, as '),
        ({'episode_1/observations': np.zeros((6, 4, 4))}, 'episode_1 has no numeric states; '
         '/episode_1/observations: images are not read'),
        ({'episode_1/rewards': None}, 'has rewards in some episodes only; expected them in all'),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_named(tmp_path, change, said):
    minari(tmp_path / 'data.hdf5', [3, 5])
    with h5py.File(tmp_path / 'data.hdf5', 'a') as file:
        for name, values in change.items():
            del file[name]
            if values is not None:
                file[name] = values
    with pytest.raises(RecordingError) as error:
        episodes_of_recording(tmp_path / 'data.hdf5')
    assert said in str(error.value)


def test_an_episode_with_a_number_that_is_none_is_dropped_and_the_number_named(tmp_path):
    minari(tmp_path / 'data.hdf5', [3, 5, 4, 6])
    with h5py.File(tmp_path / 'data.hdf5', 'a') as file:
        file['episode_1/observations'][2, 3] = np.nan
        file['episode_2/rewards'][0] = np.inf
        file['episode_3/observations'][6] = np.nan  # What the last step reaches is no step.
    found = episodes_of_recording(tmp_path / 'data.hdf5')
    assert [len(episode) for episode in found.episodes] == [3, 6]
    assert found.dropped == {
        'episodes in which obs_3 is not a finite number': 1,
        'episodes in which the reward is not a finite number': 1,
    }


def test_a_file_of_something_else_is_one_sentence(tmp_path):
    write(tmp_path / 'weights.h5', {'layer/kernel': np.zeros(3)})
    with pytest.raises(RecordingError, match=r'no group of observations or obs.*it has layer'):
        episodes_of_recording(tmp_path / 'weights.h5')
    (tmp_path / 'torn.h5').write_bytes(b'no')
    with pytest.raises(RecordingError, match='cannot be read as HDF5'):
        episodes_of_recording(tmp_path / 'torn.h5')


def write_messages(path, **more):
    """Write a group /run of messages at 10 Hz, and more data sets by name."""
    contents = {'run/timestamp': np.arange(60) / 10, 'run/x': np.arange(60.0)}
    return write(path, contents | {f'run/{name}': values for name, values in more.items()})


MESSAGES = parse_robot_file(
    'step: {rate: 10}\nchannels: {x: /run.x, near: "/run.ranges[1]"}\nreward: x\n'
    'episode: {steps: 5}\n'
)


def test_rows_of_numbers_of_any_length(tmp_path):
    ranges = np.empty(60, object)
    ranges[:] = [np.arange(2.0 + row % 3) * row for row in range(60)]
    path = write_messages(tmp_path / 'run.h5')
    with h5py.File(path, 'a') as file:
        file.create_dataset('run/ranges', data=ranges, dtype=h5py.vlen_dtype(float))
    found = episodes_of_recording(path, MESSAGES)
    assert len(found.episodes) == 10
    for episode in found.episodes:
        np.testing.assert_array_equal(episode.states[:, 1], episode.states[:, 0])
    assert '"/run.x"' in robot_file_of_recording(path)


def test_a_group_without_a_time_for_each_row_is_no_table(tmp_path):
    path = write_messages(tmp_path / 'run.h5', ranges=np.arange(120.0).reshape(60, 2))
    with h5py.File(path, 'a') as file:
        file['about/timestamp'] = 17.5
        file['folder/timestamp/zone'] = np.zeros(3)
    assert len(episodes_of_recording(path, MESSAGES).episodes) == 10
    assert '/about' not in robot_file_of_recording(path)


@pytest.mark.parametrize('shape', [(300, 400, 700, 1), (300, 280_000)])
def test_pictures_among_messages_do_not_fill_the_memory(tmp_path, shape):
    with h5py.File(tmp_path / 'run.h5', 'w') as file:
        file['cam/timestamp'] = np.arange(shape[0]) / 10
        file['cam/light'] = np.arange(shape[0])
        # Never written: 84 MB of zeros that take no place in the file.
        file.create_dataset('cam/rgb', shape, np.uint8, chunks=(1, *shape[1:]))
    tracemalloc.start()
    try:
        assert '"/cam.light"' in robot_file_of_recording(tmp_path / 'run.h5')
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
