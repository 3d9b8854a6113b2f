# SPDX-License-Identifier: Apache-2.0

"""What the worker process inherits from the node."""

import os
import time
from functools import partial
from pathlib import Path

import pytest

from cmifs_ros.ros.worker import WorkerProcess


@pytest.mark.parametrize('own', [None, '7'])
def test_its_linear_algebra_has_one_thread_whatever_that_of_the_node_has(monkeypatch, own):
    monkeypatch.delenv('OPENBLAS_NUM_THREADS', raising=False)
    if own is not None:
        monkeypatch.setenv('OPENBLAS_NUM_THREADS', own)
    worker = WorkerProcess(os.getpid)
    worker.submit(os.getpid)
    try:
        while (job := worker.outcome()) is None:
            time.sleep(0.01)
        # What it was started with: the library reads that when it is imported.
        inherited = Path(f'/proc/{job.result()}/environ').read_bytes().split(b'\0')
        assert b'OPENBLAS_NUM_THREADS=1' in inherited
        assert os.environ.get('OPENBLAS_NUM_THREADS') == own
    finally:
        worker.stop()


def test_it_ends_at_once_while_a_large_job_is_on_its_way_to_it():
    worker = WorkerProcess(partial(time.sleep, 60))
    worker.submit(len, bytes(10_000_000))
    begin = time.monotonic()
    worker.stop()
    assert time.monotonic() - begin < 30
