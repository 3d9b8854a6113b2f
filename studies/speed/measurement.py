# SPDX-License-Identifier: Apache-2.0

"""One measurement in a separate process: seconds and peak memory of one ranking.

In a new process the BLAS threads can be set before NumPy is loaded, and the peak memory is that of
this ranking alone. The process runs this module: it reads a `Job` as JSON from its argument and
prints a `Measurement` as JSON.
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
        Number of threads of this package and of ennemi.
    blas_threads : int
        Number of BLAS threads in each process.
    scenario, episodes, steps, channels, seed
        As in `rollout_scaled`; the method has the same seed.
    top : int, optional
        Number of channels to rank; None ranks all.

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
    """Return the job of a method on the data given by command-line options."""
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
    """Time and peak resident memory of a ranking, and the ranking with its scores.

    The processor seconds are those of all threads of the process.
    """

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    ranking: list[int]
    scores: list[float]


def measure(job: Job) -> Measurement:
    """Measure in a new process.

    Raises
    ------
    CommandError
        If it dies, for example for lack of memory.

    """
    process = subprocess.run(
        [sys.executable, '-m', 'studies.speed.measurement', json.dumps(job)],
        env=os.environ | dict.fromkeys(THREAD_VARIABLES, str(job.blas_threads)),
        stdout=subprocess.PIPE,
        text=True,
        check=False,
        start_new_session=True,  # Ctrl-C is for the command, which then ends this process.
    )
    if process.returncode != 0:
        raise CommandError(f'the process that measured {job} ended with {process.returncode}')
    return Measurement(*json.loads(process.stdout))


def measure_here(job: Job) -> Measurement:
    """Measure in this process, after a first round that loads and compiles."""
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
    start, used = time.perf_counter(), time.process_time()
    ranking = run(job.top)
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - used
    return Measurement(seconds, cpu_seconds, peak_bytes(os.getpid()), *ranking)


def peak_bytes(pid: int) -> int:
    """Return the greatest resident memory of a process so far, from Linux.

    ru_maxrss is unsuitable: it starts with the memory of the parent process.
    """
    lines = Path(f'/proc/{pid}/status').read_text().splitlines()
    (line,) = (line for line in lines if 'VmHWM' in line)
    return int(line.split()[1]) * 1024


if __name__ == '__main__':
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Nobody is waiting: end without a message.
    print(json.dumps(measure_here(Job(*json.loads(sys.argv[1])))))
