# SPDX-License-Identifier: Apache-2.0

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from processes import is_running

pytest.importorskip('joblib')
pytest.importorskip('matplotlib')

from cmifs_ros.sim import rollout
from studies.methods.registry import rank
from studies.speed import benchmark
from studies.speed import growth as benchmark_growth
from studies.tasks.registry import rollout_scaled
from studies.trials.statistics import rank_sum

ROOT = Path(__file__).parents[2]
TINY = ('--episodes', '8', '--steps', '6', '--channels', '5', '--top', '2', '--trials', '2')


@pytest.fixture(scope='module')
def report():
    """Return what `benchmark --json` prints, run as a user runs it."""
    options = [
        '--methods',
        'direct_port,score_as_port',
        '--jobs',
        '1',
        '--first-seed',
        '4',
        '--json',
    ]
    done = subprocess.run(
        [sys.executable, '-m', 'studies.speed.benchmark', *TINY, *options],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_it_measures_each_method_on_the_same_data(report):
    port, ours = report['rows']
    assert (port['method'], ours['method']) == ('direct_port', 'score_as_port')
    for row in report['rows']:
        assert len(row['seconds_of_trials']) == 2
        assert row['seconds'] == np.median(row['seconds_of_trials']) > 0
        faster = port['seconds'] / row['seconds']
        assert row['times_faster_than_direct_port'] == pytest.approx(faster)
        assert 20e6 < row['peak_bytes'] < 1e9
    assert (port['times_faster_than_direct_port'], ours['cores']) == (1, 1)
    assert report['data'] == {
        'scenario': 'with_gravel', 'episodes': 8, 'steps': 6, 'channels': 5, 'top': 2,
        'first_seed': 4, 'trials': 2,
    }  # fmt: skip


def test_its_rank_sums_are_those_of_the_rankings_of_its_seeds(report):
    for row in report['rows']:
        sums = []
        for seed in (4, 5):
            episodes = rollout_scaled('with_gravel', 8, seed, num_steps=6, num_channels=5)
            ranking = rank(row['method'], episodes, target=(0,), seed=seed, num_features=2).channels
            assert len(ranking) == 2
            sums.append(rank_sum(ranking, (0, 1, 2, 3), 5))
        assert row['rank_sums'] == sums
        assert row['rank_sum'] == np.mean(sums)
        assert row['rank_sum_error'] == pytest.approx(abs(sums[0] - sums[1]) / 2)


def test_the_table_names_what_is_not_installed(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'ennemi', None)
    monkeypatch.setitem(sys.modules, 'sklearn', None)
    options = ['--trials', '1', '--jobs', '1', '--methods', 'kdr,ennemi,sklearn']
    assert benchmark.main([*TINY, *options]) == 0
    table = [line for line in capsys.readouterr().out.splitlines() if line.startswith('|')]
    assert [line.split(' | ')[0] for line in table[2:]] == [
        '| KDR',
        '| ennemi, a step and a channel at a time',
        '| scikit-learn, a step and a channel at a time',
    ]
    assert 'not installed: python3 -m pip install ennemi' in table[3]
    assert 'not installed: python3 -m pip install scikit-learn' in table[4]


def test_growth_is_measured_tabulated_and_plotted(tmp_path, capsys):
    options = ['episodes', '--sizes', '6,12', '--channels', '4', '--top', '1', '--steps', '10']
    assert benchmark_growth.main([*options, '--trials', '1', '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert '\n| 6 | ' in output
    assert '\n| 12 | ' in output
    path = tmp_path / 'growth_episodes.png'
    assert path.read_bytes().startswith(b'\x89PNG')
    assert f'written: {path}' in output


def test_the_exponent_is_the_slope_of_the_logarithms():
    points = [benchmark_growth.Point(n, 0.02 * n**1.5, 0.0, 0) for n in (10, 30, 200)]
    assert benchmark_growth.exponent(points) == pytest.approx(1.5)


def test_the_grid_world_in_its_own_size_is_the_grid_world():
    scaled, own = rollout_scaled('with_gravel', 3, 5), rollout('with_gravel', 3, 5)
    for a, b in zip(scaled, own, strict=True):
        np.testing.assert_array_equal(a.states, b.states)
        np.testing.assert_array_equal(a.rewards, b.rewards)


def test_longer_and_wider_episodes_are_rounds_of_the_world_with_more_noise():
    scaled = rollout_scaled('without_gravel', 2, 5, num_steps=50, num_channels=17)
    own = rollout('without_gravel', 6, 5)
    for i, episode in enumerate(scaled):
        assert episode.states.shape == (50, 17)
        rounds = np.concatenate([e.states for e in own[3 * i : 3 * i + 3]])
        np.testing.assert_array_equal(episode.states[:, :14], rounds[:50])
        noise = episode.states[:, 14:]
        np.testing.assert_array_equal(noise, np.floor(noise))
        assert len(np.unique(noise)) > 2


def test_channels_that_were_not_ranked_count_as_in_random_order():
    assert rank_sum((2, 0, 1), (0, 1), 3) == 5
    assert rank_sum((2, 0), (0, 1), 6) == 2 + (3 + 4 + 5 + 6) / 4


def children(pid):
    """Return the processes that a process has started and that live."""
    return Path(f'/proc/{pid}/task/{pid}/children').read_text().split()


def is_measuring(pid):
    """Tell whether a process has NumPy loaded: it is past its start."""
    return 'numpy' in Path(f'/proc/{pid}/maps').read_text()


def test_ctrl_c_ends_it_with_a_sentence_and_leaves_no_process():
    process = subprocess.Popen(
        [sys.executable, '-m', 'studies.speed.benchmark', '--methods', 'direct_port'],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 60
        while not (measuring := list(filter(is_measuring, children(process.pid)))):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        output, errors = process.communicate(timeout=20)
    finally:
        process.kill()
    assert (process.returncode, output) == (130, '')
    assert errors == '\nbenchmark: interrupted; nothing is kept\n'
    while any(map(is_running, measuring)):
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize(
    ('command', 'arguments', 'message'),
    [
        (
            benchmark,
            ['--episodes', '1'],
            "argument --episodes: got '1'; expected a whole number from 2",
        ),
        (benchmark, ['--top', '15'], 'argument --top: it is 15; there are 14 channels'),
        (benchmark, ['--methods', 'mi'], "got 'mi'; expected some of direct_port, score_as_port"),
        (benchmark, ['--jobs', '0,2'], "argument --jobs: got '0,2'; expected whole numbers from 1"),
        (benchmark_growth, ['time'], "got 'time'; expected some of episodes, steps, channels"),
        (benchmark_growth, ['--sizes', '5'], 'argument --sizes: name one dimension for them'),
        (benchmark_growth, ['channels', '--sizes', '4,9'], 'it is 8; there are 4 channels'),
    ],
)
def test_bad_arguments_are_one_clear_sentence(command, arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        command.main(arguments)
    assert end.value.code == 2
    assert message in capsys.readouterr().err
