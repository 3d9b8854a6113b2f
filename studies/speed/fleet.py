# SPDX-License-Identifier: Apache-2.0

"""What a selection from a fleet's bags costs on one machine, and on local clusters of Dask.

The bags are written first. Each selection is `select_from_bag` in a process of its own, so that its
peak memory is known; a cluster begins anew for each.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import joblib
from tqdm import tqdm

from cmifs_ros.tools.arguments import home_path, number_from
from cmifs_ros.tools.program import CommandError, exit_code
from studies.trials.arguments import numbers_from
from studies.trials.tables import markdown_table, table_row

from .benchmark import machine
from .fleet_bags import write_bag
from .measurement import THREAD_VARIABLES, peak_bytes
from .relay import Relay

#: The argument by which this module runs a selection and prints what it took.
_SELECT = '--select'

_HEADS = (
    'steps', 'bags', 'where', 'seconds', 'selecting', 'processor seconds', 'command', 'worker',
    'received', 'sent', 'between workers', 'selection',
)  # fmt: skip


class Cost(NamedTuple):
    """What a selection took, and what it selected.

    Attributes
    ----------
    seconds, selecting : float
        In all, and without reading.
    cpu : float
        Processor seconds of the command and the workers.
    client_bytes : int
        Peak memory of the command.
    selection : dict
    worker_bytes : int
        The greatest peak memory of a worker.
    received, sent, between : int
        Bytes that the command received from the cluster and sent to it, and between workers.

    """

    seconds: float
    selecting: float
    cpu: float
    client_bytes: int
    selection: dict
    worker_bytes: int = 0
    received: int = 0
    sent: int = 0
    between: int = 0


def select_here(arguments: list[str]) -> int:
    """Run `select_from_bag` and print, last, its peak memory and processor seconds."""
    from cmifs_ros.tools.select_from_bag import main as select_from_bag

    code = select_from_bag(arguments)
    print(peak_bytes(os.getpid()), time.process_time())
    return code


def cost_of(bags: list[Path], out: Path, *options: str) -> Cost:
    """Select from bags and return what it took."""
    start = time.perf_counter()
    done = subprocess.run(
        [
            sys.executable, '-m', 'studies.speed.fleet', _SELECT,
            *map(str, bags), '--out', str(out), *options,
        ],
        env=os.environ | dict.fromkeys(THREAD_VARIABLES, '1'),
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise CommandError(f'the selection ended with {done.returncode}')
    seconds = time.perf_counter() - start
    selection = json.loads((out / 'selection.json').read_text())
    selecting = selection.pop('seconds')
    peak, cpu = done.stdout.split()[-2:]
    return Cost(seconds, selecting, float(cpu), int(peak), selection)


def cost_on_cluster(bags: list[Path], out: Path, num_workers: int) -> Cost:
    """Select from bags on a cluster of so many workers of a thread each."""
    from distributed import Client, LocalCluster

    with LocalCluster(
        n_workers=num_workers, threads_per_worker=1, processes=True, dashboard_address=':0'
    ) as cluster:
        with Relay(cluster.scheduler_address) as relay:
            cost = cost_of(bags, out, '--scheduler', relay.address)
        with Client(cluster) as client:
            peaks = client.run(lambda: peak_bytes(os.getpid())).values()
            between = client.run(_received).values()
            cpu = cost.cpu + sum(client.run(time.process_time).values())
    return cost._replace(
        cpu=cpu,
        worker_bytes=max(peaks),
        received=relay.received,
        sent=relay.sent,
        between=sum(between),
    )


def _received(dask_worker) -> int:
    return sum(transfer['total'] for transfer in dask_worker.transfer_incoming_log)


def run(options: argparse.Namespace) -> None:
    """Write the bags, select in each way, and print the table."""
    print(', '.join(f'{name} {value}' for name, value in machine().items()))
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        bags = [Path(folder, 'bags', f'{i:05}') for i in range(max(options.bags))]
        shape = {name: getattr(options, name) for name in ('episodes', 'steps', 'channels')}
        bags[0].parent.mkdir()
        writing = joblib.Parallel(options.writers, return_as='generator')(
            joblib.delayed(write_bag)(bag, i, **shape) for i, bag in enumerate(bags)
        )
        for _ in tqdm(writing, 'writing', len(bags), unit=' bags', disable=None, leave=False):
            pass
        print(f'{options.episodes} episodes of {options.steps} steps a bag, '
              f'{options.channels} channels\n\n{markdown_table(_HEADS, [])}', end='')  # fmt: skip
        for count in options.bags:
            written = sum(f.stat().st_size for bag in bags[:count] for f in bag.iterdir())
            size = count * options.episodes * options.steps, _size(written)
            whole = cost_of(bags[:count], Path(folder, 'out'))
            print(table_row([*size, 'one process', *_cells(whole), '']), flush=True)
            for workers in options.workers:
                cost = cost_on_cluster(bags[:count], Path(folder, 'out'), workers)
                same = 'the same' if cost.selection == whole.selection else 'another'
                where = f'{workers} worker{"s" if workers > 1 else ""}'
                print(table_row([*size, where, *_cells(cost), same]), flush=True)


def _cells(cost: Cost) -> list[str]:
    seconds = [f'{value:.1f}' for value in (cost.seconds, cost.selecting, cost.cpu)]
    sizes = [cost.worker_bytes, cost.received, cost.sent, cost.between]
    of_cluster = [_size(size) if cost.worker_bytes else '' for size in sizes]
    return [*seconds, _size(cost.client_bytes), *of_cluster]


def _size(num_bytes: int) -> str:
    return f'{float(f"{num_bytes / 1e6:.3g}"):g} MB'  # never 1.44e+03


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = argparse.ArgumentParser(
        'fleet', description=' '.join(__doc__.split()), allow_abbrev=False
    )
    cores = joblib.cpu_count()
    parser.add_argument(
        '--bags', type=numbers_from(1), default='20', metavar='N,...',
        help='numbers of bags, each measured (default %(default)s)',
    )  # fmt: skip
    parser.add_argument('--episodes', type=number_from(2), default=10, help='of a bag (default 10)')
    parser.add_argument(
        '--steps', type=number_from(2), default=200, help='of an episode (default 200)'
    )
    parser.add_argument('--channels', type=number_from(2), default=50, help='default 50')
    parser.add_argument(
        '--workers', type=numbers_from(1), default=','.join(map(str, sorted({1, 2, cores}))),
        metavar='N,...', help='numbers of workers (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--writers', type=number_from(1), default=cores, help='processes that write the bags'
    )
    parser.add_argument(
        '--folder', type=home_path, metavar='FOLDER', help='where the bags are kept meanwhile'
    )
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code('fleet', lambda: run(options))


if __name__ == '__main__':
    own = sys.argv[1:]
    sys.exit(select_here(own[1:]) if own[:1] == [_SELECT] else main())
