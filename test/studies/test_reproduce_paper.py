# SPDX-License-Identifier: Apache-2.0

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import group

pytest.importorskip('joblib')
pytest.importorskip('matplotlib')

from cmifs_ros.sim import rollout
from cmifs_ros.tools.program import CommandError
from studies.paper.figures import gravel_histogram, plan
from studies.paper.reproduce import main
from studies.trials.log import TrialLog
from studies.trials.parallel import IS_OLD_JOBLIB
from studies.trials.trial import Outcome, Results, Trial, run_trial

ROOT = Path(__file__).parents[2]
TINY = ('--trials', '2', '--episodes', '10', '--methods', 'kdr')


def rows(folder):
    with (folder / 'trials.csv').open(newline='') as file:
        return list(csv.DictReader(file))


def rankings(folder):
    """Return what was found, by trial, whatever the order and the computing time."""
    return {
        tuple(v for k, v in row.items() if k not in ('ranking', 'seconds')): row['ranking']
        for row in rows(folder)
    }


@pytest.fixture(scope='module')
def serial(tmp_path_factory):
    """Return the folder of a run in one process."""
    folder = tmp_path_factory.mktemp('serial')
    assert main([*TINY, '--jobs', '1', '--out', str(folder)]) == 0
    return folder


def test_it_writes_trials_figures_and_table(serial):
    assert {path.name for path in serial.iterdir()} == {
        'trials.csv',
        'table.md',
        *(f'figure_{name}.{kind}' for name in ('6a', '6b', '7') for kind in ('png', 'pdf')),
    }
    assert (serial / 'figure_7.png').read_bytes().startswith(b'\x89PNG')
    assert (serial / 'figure_6a.pdf').read_bytes().startswith(b'%PDF')
    found = rows(serial)
    assert [(r['scenario'], r['method'], r['episodes'], r['trial'], r['seed']) for r in found] == [
        (scenario, 'kdr', '10', trial, trial)
        for trial in ('0', '1')
        for scenario in ('without_gravel', 'with_gravel')
    ]
    for row in found:
        assert sorted(map(int, row['ranking'].split())) == list(range(14))
        assert float(row['seconds']) > 0
    sums = [
        sum(row['ranking'].split().index(i) + 1 for i in '01')
        for row in found
        if row['scenario'] == 'without_gravel'
    ]
    error = abs(sums[0] - sums[1]) / 2
    assert f'| 10 | 2 | {sum(sums) / 2:.2f} ± {error:.2f} |' in (serial / 'table.md').read_text()


def test_two_processes_find_the_same(serial, tmp_path):
    assert main([*TINY, '--jobs', '2', '--out', str(tmp_path)]) == 0
    assert rankings(tmp_path) == rankings(serial)
    assert (tmp_path / 'table.md').read_text() == (serial / 'table.md').read_text()


@pytest.mark.skipif(IS_OLD_JOBLIB, reason='joblib 1.4 is needed')
def test_a_dask_cluster_of_two_processes_finds_the_same(serial, tmp_path):
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        options = ['--scheduler', cluster.scheduler_address, '--out', str(tmp_path)]
        assert main([*TINY, *options]) == 0
    assert rankings(tmp_path) == rankings(serial)
    assert (tmp_path / 'table.md').read_text() == (serial / 'table.md').read_text()


def test_an_interrupted_run_continues_where_it_stopped(serial, tmp_path):
    log = tmp_path / 'trials.csv'
    lines = (serial / 'trials.csv').read_bytes().splitlines(keepends=True)
    kept = b''.join(lines[:3])
    log.write_bytes(kept + lines[3][:-4])  # killed while it wrote
    assert main([*TINY, '--jobs', '1', '--out', str(tmp_path)]) == 0
    assert log.read_bytes().startswith(kept)
    assert rankings(tmp_path) == rankings(serial)
    assert len(rows(tmp_path)) == 4

    before = log.read_bytes()
    assert main([*TINY, '--jobs', '1', '--out', str(tmp_path)]) == 0
    assert log.read_bytes() == before

    # Another seed shares its first trial with the second of seed 0, for it has its seed.
    assert main([*TINY, '--jobs', '1', '--first-seed', '1', '--out', str(tmp_path)]) == 0
    assert {(r['trial'], r['seed']) for r in rows(tmp_path)} == {
        ('0', '0'), ('1', '1'), ('0', '1'), ('1', '2')
    }  # fmt: skip


def test_figures_6b_and_7_share_their_trials_and_each_is_planned_once():
    both = plan(('6b', '7'), ('kdr', 'paper'), (20, 100), 3, seed=5)
    assert len(both) == len(set(both)) == 3 * 2 * 2
    assert both == plan(('6b',), ('kdr', 'paper'), (20, 100), 3, seed=5)
    only = plan(('7',), ('kdr', 'paper'), (20, 100), 3, seed=5)
    assert only == [trial for trial in both if trial.episodes == 100]
    assert {(trial.number, trial.seed) for trial in only} == {(0, 5), (1, 6), (2, 7)}


@pytest.mark.parametrize('scenario', ['without_gravel', 'with_gravel'])
def test_the_first_episodes_of_a_longer_rollout_are_those_of_a_shorter(scenario):
    for short, long in zip(rollout(scenario, 3, 8), rollout(scenario, 9, 8), strict=False):
        assert short.states.tobytes() == long.states.tobytes()
        assert short.rewards.tobytes() == long.rewards.tobytes()


@pytest.mark.parametrize('method', ['paper', 'kdr', 'default'])
def test_a_trial_ranks_all_features_the_same_way_each_time(method):
    trial = Trial('with_gravel', method, 6, 0, 3)
    outcome = run_trial(trial)
    assert sorted(outcome.ranking) == list(range(14))
    assert run_trial(trial).ranking == outcome.ranking
    assert outcome.rank_sum == sum(outcome.rank(i) for i in range(4))


def test_results_do_not_depend_on_the_order_of_the_trials():
    outcomes = [
        Outcome(Trial('with_gravel', 'kdr', 10, i, i), (*range(i, 14), *range(i)), 1.0)
        for i in range(4)
    ]
    for shuffled in (outcomes, outcomes[::-1]):
        results = Results(shuffled)
        sums = [o.rank_sum for o in outcomes]
        assert results.rank_sum('with_gravel', 'kdr', 10)[0] == sum(sums) / 4
        histogram = gravel_histogram(results, 'kdr', 10)
        assert histogram.tolist() == [1, 1, 1, 1] + 10 * [0]


def test_a_file_that_is_no_log_of_trials_is_refused(tmp_path):
    path = tmp_path / 'trials.csv'
    path.write_text('a,b\n')
    with pytest.raises(CommandError, match=r"begins with \['a', 'b'\]; expected the columns"):
        TrialLog(path)
    for line, problem in (
        ('6a,without_gravel,kdr,10,0,0,0 1,0.1\n', 'line 2 is .*; expected 7 values'),
        ('without_gravel,kdr,many,0,0,0 1,0.1\n', 'line 2 is not a trial'),
    ):
        path.unlink()
        TrialLog(path)
        with path.open('a') as file:
            file.write(line)
        with pytest.raises(CommandError, match=problem):
            TrialLog(path)
    assert main([*TINY, '--out', str(tmp_path)]) == 1


def test_ctrl_c_ends_it_with_a_sentence_and_leaves_no_process(tmp_path):
    output = tmp_path / 'output'
    with output.open('w') as file:
        process = subprocess.Popen(
            [sys.executable, '-m', 'studies.paper.reproduce', '--methods', 'kdr',
             '--episodes', '30', '--trials', '500', '--jobs', '2', '--out', tmp_path],
            cwd=ROOT, stdout=file, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip

    def until(condition):
        deadline = time.monotonic() + 60
        while not condition():
            assert time.monotonic() < deadline, output.read_text()
            time.sleep(0.05)

    try:
        log = tmp_path / 'trials.csv'
        until(lambda: log.exists() and log.read_bytes().count(b'\n') > 3)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        assert process.wait(20) == 130
        until(lambda: group(process.pid) == [])
    finally:
        for pid in group(process.pid):
            os.kill(pid, signal.SIGKILL)
        process.wait()
    assert 'Traceback' not in output.read_text()
    assert output.read_text().endswith(
        'reproduce_paper: interrupted; the same command continues where it stopped\n'
    )
    assert log.read_bytes().endswith(b'\n')


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--trials', '0'], "argument --trials: got '0'; expected a whole number from 1"),
        (['--episodes', '20,x'], "argument --episodes: got '20,x'; expected whole numbers from 2"),
        (['--episodes', '1'], "argument --episodes: got '1'; expected whole numbers from 2"),
        (['--figure', '8'], "argument --figure: invalid choice: '8'"),
        (['--methods', 'kdr,mi'], "got 'kdr,mi'; expected some of paper, kdr, default"),
        (['--first-seed', '-1'], "argument --first-seed: got '-1'; expected a whole number from 0"),
        (['--jobs', '0'], "argument --jobs: got '0'; expected a whole number from 1"),
        (['--jobs', '1', '--scheduler', 'a:1'], 'not allowed with argument'),
    ],
)
def test_bad_arguments_are_one_clear_sentence(arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_one_clear_sentence(tmp_path, capsys):
    (tmp_path / 'file').touch()
    with pytest.raises(SystemExit):
        main([*TINY, '--out', str(tmp_path / 'file')])
    assert 'file is not a folder; expected a folder, existing or not' in capsys.readouterr().err


def test_a_cluster_without_its_package_is_refused_with_a_hint(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main([*TINY, '--scheduler', 'tcp://127.0.0.1:1', '--out', str(tmp_path)]) == 1
    assert 'python3 -m pip install distributed' in capsys.readouterr().err
