# SPDX-License-Identifier: Apache-2.0

"""The command on tables and HDF5: the same report as of bags."""

import json
import shutil

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
import pyarrow as pa
from pyarrow import parquet

from cmifs_ros.tools.select_from_bag import main


def write(path, num_episodes=40, reward=True, seed=0):
    """Write episodes of 4 steps: x is the action and pays, y is noise."""
    rng = np.random.default_rng(seed)
    # Each episode is at a place of its own.
    x = np.repeat(rng.normal(size=num_episodes), 4) + 0.1 * rng.normal(size=4 * num_episodes)
    y = rng.normal(size=len(x))
    columns = {
        'episode_index': np.repeat(np.arange(num_episodes), 4),
        'observation.x': x,
        'observation.y': y,
        'action': x + 0.3 * rng.normal(size=len(x)),
    }
    if reward:
        columns['next.reward'] = x + 0.01 * rng.normal(size=len(x))
    parquet.write_table(pa.table(columns), path)
    return path


def selected(tmp_path, *arguments):
    assert main([*map(str, arguments), '--out', str(tmp_path / 'out')]) == 0
    return json.loads((tmp_path / 'out' / 'selection.json').read_text())


def test_a_table_of_steps_has_the_report_of_a_bag(tmp_path, capsys):
    path = write(tmp_path / 'steps.parquet')
    report = tmp_path / 'page'
    selection = selected(tmp_path, path, '--report', report)
    assert (selection['names'], selection['episodes']) == (['x'], 40)
    printed = capsys.readouterr().out
    assert f'{path}: 160 steps, 40 complete episodes' in printed
    assert 'keep these:\n  x: adds' in printed
    assert '<h1>Selected: x' in (report / 'index.html').read_text()


def test_columns_with_names_of_their_own_need_roles(tmp_path, capsys):
    path = write(tmp_path / 'steps.parquet')
    names = ['batch', 'x', 'y', 'speed', 'paid']
    parquet.write_table(parquet.read_table(path).rename_columns(names), path)
    assert main([str(path), '--out', str(tmp_path)]) == 1
    assert '--episode or --done, --reward, --action' in capsys.readouterr().err
    roles = '--episode', 'batch', '--reward', 'paid', '--action', 'speed'
    assert selected(tmp_path, path, *roles)['names'] == ['x']
    assert main([str(path), '--out', str(tmp_path), '--reward', 'x', '--action', 'x,y']) == 1
    assert 'x has two roles' in capsys.readouterr().err


def test_demonstrations_without_a_reward_need_the_target_action(tmp_path, capsys):
    path = write(tmp_path / 'steps.parquet', reward=False)
    assert main([str(path), '--out', str(tmp_path)]) == 1
    assert (
        "has no column next.reward or next.success, which target 'return' needs: --target action"
        in capsys.readouterr().err
    )
    assert selected(tmp_path, path, '--target', 'action')['names'] == ['x']


def test_a_folder_of_recordings_is_pooled_and_a_copy_counts_once(tmp_path, capsys):
    folder = tmp_path / 'runs'
    folder.mkdir()
    write(folder / 'run_1.parquet')
    write(folder / 'run_2.parquet', seed=1)
    shutil.copy(folder / 'run_1.parquet', folder / 'run_10.parquet')
    selection = selected(tmp_path, folder)
    assert selection['episodes'] == 80
    printed = capsys.readouterr().out
    assert 'run_10.parquet: 40 of 40 episodes left out, because they were recorded twice' in printed


def test_a_robot_file_reads_a_table_as_messages(tmp_path, capsys):
    steps = np.arange(300)
    x = np.repeat(np.random.default_rng(0).normal(size=50), 6)
    table = pa.table({'timestamp': steps / 10, 'x': x, 'pay': np.append(0.0, x[:-1])})
    parquet.write_table(table, tmp_path / 'drive.parquet')
    robot = tmp_path / 'robot.yaml'
    robot.write_text(
        'step: {topic: /drive}\nchannels: {x: /drive.x}\nreward: /drive.pay\nepisode: {steps: 5}\n'
    )
    selection = selected(tmp_path, tmp_path / 'drive.parquet', '--robot', robot)
    assert (selection['names'], selection['episodes']) == (['x'], 50)
    printed = capsys.readouterr().out
    assert '300 messages, 50 complete episodes' in printed
    assert 'keep these:\n  /drive: x adds' in printed
