# SPDX-License-Identifier: Apache-2.0

"""A study ends with a sentence or in silence, whenever it is told to."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import group

pytest.importorskip('joblib')
pytest.importorskip('matplotlib')
pytest.importorskip('sklearn')

ROOT = Path(__file__).parents[2]
STUDIES = {
    'studies.accuracy.oracle': ['--trials', '500'],
    'studies.learning.curves': ['--trials', '500', '--out', 'trials.csv'],
}


@pytest.fixture(params=STUDIES)
def study(request, tmp_path):
    """Start a study; give its process and the file of its output."""
    with (tmp_path / 'output').open('w') as file:
        process = subprocess.Popen(
            [sys.executable, '-m', request.param, *STUDIES[request.param], '--jobs', '2'],
            cwd=tmp_path,
            env=os.environ | {'PYTHONPATH': f'{ROOT}:{os.environ.get("PYTHONPATH", "")}'},
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    yield process, Path(file.name)
    for pid in group(process.pid):
        os.kill(pid, signal.SIGKILL)
    process.wait()


def wait_until(condition, process, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)


def workers_of(process):
    return [
        pid for pid in group(process.pid)
        if b'popen_loky' in Path(f'/proc/{pid}/cmdline').read_bytes()
    ]  # fmt: skip


def ignores_ctrl_c(process):
    """Tell whether it does, as for the moment in which it starts its workers."""
    status = Path(f'/proc/{process.pid}/status').read_text()
    ignored = int(re.search(r'SigIgn:\s*(\w+)', status)[1], 16)
    return bool(ignored >> signal.SIGINT - 1 & 1)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_is_imported_ends_it_in_silence(study, number):
    process, output = study
    wait_until(
        lambda: '_multiarray_umath' in Path(f'/proc/{process.pid}/maps').read_text(), process
    )
    os.killpg(process.pid, number)
    assert process.wait(20) == 128 + number
    assert output.read_text() == ''


def test_ctrl_c_while_its_workers_start_ends_it_with_a_sentence(study):
    process, output = study
    wait_until(lambda: workers_of(process) and not ignores_ctrl_c(process), process)
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(20) == 130
    assert 'Traceback' not in output.read_text()
    assert ': interrupted; ' in output.read_text()


def test_a_worker_that_dies_ends_it_with_a_sentence(study):
    process, output = study
    wait_until(lambda: workers_of(process), process)
    os.kill(workers_of(process)[0], signal.SIGKILL)
    assert process.wait(60) == 1
    assert 'Traceback' not in output.read_text()
    assert ': a worker process died; ' in output.read_text()
