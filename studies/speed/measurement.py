# SPDX-License-Identifier: Apache-2.0

"""One measurement in a process of its own: seconds and peak memory of one ranking.

A fresh process has the threads of its linear algebra set before NumPy is loaded, and its peak
memory is that of this ranking alone. The process is this module: it reads a `Job` as JSON from
its argument and prints a `Measurement` as JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from cmifs_ros.tools.program import CommandError
from studies.methods.registry import rank
from studies.tasks.registry import TASKS, rollout_scaled

THREAD_VARIABLES = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


class Job(NamedTuple):
    """What to measure: a method on the grid world in some size.

    Attributes
    ----------
    method : str
        One of `METHODS`.
    cores : int
        How many to use: threads of ours and of ennemi.
    blas_threads : int
        Threads of the linear algebra in each process.
    scenario, episodes, steps, channels, seed
        As of `rollout_scaled`; the seed is also the method's.
    top : int, optional
        How many channels to rank; None ranks all.

    """

    method: str
    cores: int
    blas_threads: int
    scenario: str
    episodes: int
    steps: int
    channels: int
    seed: int
    top: int | None


def job_of(options: argparse.Namespace, method: str, cores: int, blas_threads: int) -> Job:
    """Return the job of a method on the data that the options of a command describe."""
    return Job(
        method=method,
        cores=cores,
        blas_threads=blas_threads,
        scenario=options.scenario,
        episodes=options.episodes,
        steps=options.steps,
        channels=options.channels,
        seed=options.first_seed,
        top=options.top,
    )


class Measurement(NamedTuple):
    """The time and the peak of resident memory of a ranking, and the ranking with its scores."""

    seconds: float
    peak_bytes: int
    ranking: list[int]
    scores: list[float]


def measure(job: Job) -> Measurement:
    """Measure in a new process.

    Raises
    ------
    CommandError
        If it dies, for want of memory for example.

    """
    process = subprocess.run(
        [sys.executable, '-m', 'studies.speed.measurement', json.dumps(job)],
        env=os.environ | dict.fromkeys(THREAD_VARIABLES, str(job.blas_threads)),
        stdout=subprocess.PIPE,
        text=True,
        check=False,
        start_new_session=True,  # A terminal's Ctrl-C is for the command, which then ends it.
    )
    if process.returncode != 0:
        raise CommandError(f'the process that measured {job} ended with {process.returncode}')
    return Measurement(*json.loads(process.stdout))


def measure_here(job: Job) -> Measurement:
    """Measure in this process, after a first round that loads what has to be loaded."""
    episodes = rollout_scaled(
        job.scenario, job.episodes, job.seed, num_steps=job.steps, num_channels=job.channels
    )

    def run(num_features):
        return rank(
            job.method,
            episodes,
            target=TASKS[job.scenario].target,
            seed=job.seed,
            num_features=num_features,
            n_jobs=job.cores,
        )

    run(1)
    start = time.perf_counter()
    ranking = run(job.top)
    seconds = time.perf_counter() - start
    return Measurement(seconds, peak_bytes(os.getpid()), *ranking)


def peak_bytes(pid: int) -> int:
    """Return the greatest resident memory of a process so far, as Linux tells it.

    Not ru_maxrss, which begins with the memory of the process that started this one.
    """
    lines = Path(f'/proc/{pid}/status').read_text().splitlines()
    (line,) = (line for line in lines if 'VmHWM' in line)
    return int(line.split()[1]) * 1024


if __name__ == '__main__':
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Nobody waits any more: end in silence.
    print(json.dumps(measure_here(Job(*json.loads(sys.argv[1])))))
