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


def test_sources_in_a_column_count_as_those_of_several_files(tmp_path, capsys):
    ovens = []
    for number in range(3):
        table = parquet.read_table(write(tmp_path / f'oven_{number}.parquet', 20, seed=number))
        x, y, speed, paid = (table[i].to_numpy() for i in range(1, 5))
        batch = [f'{number}-{i}' for i in table['episode_index'].to_pylist()]
        # The better the oven, the greater its y.
        columns = {'batch': batch, 'x': x, 'y': y + 5 * number, 'speed': speed}
        ovens.append(pa.table(columns | {'paid': paid + 3 * number, 'oven': [number] * len(x)}))
        parquet.write_table(ovens[-1].drop_columns('oven'), tmp_path / f'oven_{number}.parquet')
    together = tmp_path / 'ovens.parquet'
    parquet.write_table(pa.concat_tables(ovens), together)
    roles = '--episode', 'batch', '--reward', 'paid', '--action', 'speed'
    apart = [tmp_path / f'oven_{number}.parquet' for number in range(3)]
    expected = selected(tmp_path, *apart, *roles, '--source', 'bag')
    found = selected(tmp_path, together, *roles, '--source-column', 'oven')
    assert found['names'] == ['x'] and found['episodes'] == 60
    assert found['sensors'] == expected['sensors']
    pooled = selected(tmp_path, together, *roles, '--ignore', 'oven')
    assert pooled['sensors'] != expected['sensors']
    both = '--source', 'bag', '--source-column', 'oven'
    assert main([str(together), '--out', str(tmp_path), *roles, *both]) == 1
    assert '--source and --source-column both name the source' in capsys.readouterr().err


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
