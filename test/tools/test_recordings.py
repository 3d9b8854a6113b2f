# SPDX-License-Identifier: Apache-2.0

"""Recordings answer alike wherever they are, and a broken one is named."""

import json
import os
import signal
import sys
from dataclasses import fields
from functools import partial

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
from bags import ROBOT, write_bag

from cmifs_ros.collect.outline import trace_of
from cmifs_ros.collect.pooling import pooled
from cmifs_ros.collect.recording import episodes_of_recording
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.tools.recordings import recordings_at
from cmifs_ros.tools.select_from_bag import main


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Return a robot file and a folder of three bags."""
    folder = tmp_path_factory.mktemp('fleet')
    robot = folder / 'robot.yaml'
    robot.write_text(ROBOT)
    for seed in range(3):
        write_bag(folder / 'bags' / str(seed), 60, seed=seed)
    return robot, folder / 'bags'


@pytest.fixture(scope='module')
def local(fleet, tmp_path_factory):
    """Return what is selected from these without a cluster."""
    return selection_of(fleet, tmp_path_factory.mktemp('local'))


@pytest.fixture(scope='module')
def cluster():
    distributed = pytest.importorskip('distributed', reason='distributed is not here')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        yield cluster


def selection_of(fleet, out, *options, bags=()):
    robot, folder = fleet
    bags = [str(bag) for bag in bags or [folder]]
    assert main([*bags, '--robot', str(robot), '--out', str(out), *options]) == 0
    return json.loads((out / 'selection.json').read_text()) | {'seconds': 0}


def test_a_cluster_reads_the_bags_and_finds_the_same(tmp_path, fleet, local, cluster):
    address = cluster.scheduler_address
    files = ['--episodes-file', str(tmp_path / 'episodes'), '--report', str(tmp_path / 'page')]
    options = ['--scheduler', address, *files]
    assert selection_of(fleet, tmp_path / 'cluster', *options) == local
    assert (tmp_path / 'episodes').exists()
    assert (tmp_path / 'page' / 'index.html').exists()
    import distributed

    with distributed.Client(address) as client:
        assert all(client.run(lambda: 'cmifs_ros.collect.bag' in sys.modules).values())


def thinned(recordings, folder):
    paths = sorted(folder.iterdir())
    read = partial(episodes_of_recording, robot=parse_robot_file(ROBOT))
    outlines = list(recordings.read(paths, read))
    named = list(zip(map(str, paths), outlines, strict=True))
    pool = pooled(named, lambda number: recordings.ask(trace_of, [number])[0])
    selector = ConditionalMISelector()
    return lambda: recordings.thinned(pool, selector)


def test_what_a_killed_worker_held_is_read_again(fleet, cluster):
    import distributed

    with recordings_at(None, jobs=1) as here:
        expected = thinned(here, fleet[1])().samples
    address = cluster.scheduler_address
    with recordings_at(address, jobs=1) as there, distributed.Client(address) as client:
        ask = thinned(there, fleet[1])
        holding = {w for workers in client.who_has().values() for w in workers}
        pids = client.run(os.getpid)
        for worker in holding:
            os.kill(pids[worker], signal.SIGKILL)
        found = ask().samples
    for field in fields(found):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        assert one is other is None or np.array_equal(one, other), field.name


@pytest.mark.parametrize('where', ['here', 'jobs', 'cluster'])
def test_a_broken_bag_is_named_and_left_out_if_asked(fleet, local, where, request, capsys):
    options = {'here': [], 'jobs': ['--jobs', '2']}.get(where)
    if options is None:
        options = ['--scheduler', request.getfixturevalue('cluster').scheduler_address]
    robot, folder = fleet
    out = robot.parent / where
    broken = out.with_suffix('.mcap')
    broken.write_bytes(b'no bag at all' * 100)
    arguments = [str(broken), str(folder), '--robot', str(robot), '--out', str(out), *options]
    assert main(arguments) == 1
    assert f'{broken} cannot be read as a bag' in capsys.readouterr().err
    bags = [broken, folder]
    assert selection_of(fleet, out, '--keep-going', *options, bags=bags) == local
    assert f'warning: left out: {broken} cannot be read as a bag' in capsys.readouterr().out


def test_if_no_recording_can_be_read_nothing_is_selected(tmp_path, fleet, capsys):
    missing = [str(tmp_path / name) for name in 'ab']
    assert main([*missing, '--robot', str(fleet[0]), '--keep-going']) == 1
    assert 'none of 2 recordings can be read' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('address', 'said'),
    [
        (None, 'needs the package distributed, here and on the cluster: python3 -m pip install'),
        ('nobody://here', "answers at nobody://here: unknown address scheme 'nobody'"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_one_sentence(fleet, address, said, capsys, monkeypatch):
    if address is None:
        monkeypatch.setitem(sys.modules, 'distributed', None)
    else:
        pytest.importorskip('distributed', reason='distributed is not here')
    robot = str(fleet[0])
    assert main(['bag', '--robot', robot, '--scheduler', address or 'here:8786']) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1
