# SPDX-License-Identifier: Apache-2.0

"""A Dask cluster to compute on.

distributed is optional: `python3 -m pip install distributed`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

import joblib

from .program import CommandError

if TYPE_CHECKING:
    from distributed import Client

#: Ubuntu 24.04 has joblib 1.3, which lacks what is needed here.
IS_OLD_JOBLIB = tuple(map(int, joblib.__version__.split('.')[:2])) < (1, 4)
#: Seconds to wait for a scheduler.
_PATIENCE = 10


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """Give a client of the cluster of a Dask scheduler.

    Raises
    ------
    CommandError
        If the cluster is unusable or breaks down.

    """
    try:
        from distributed import CancelledError, Client, KilledWorker
    except ImportError as error:
        raise CommandError(
            '--scheduler needs the package distributed, here and on the cluster: '
            'python3 -m pip install distributed'
        ) from error
    try:
        client = Client(scheduler, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        raise CommandError(f'no Dask scheduler answers at {scheduler}: {error}') from error
    with client:
        # A worker without the package would not report it: its task would never end.
        has_package = client.run(lambda: find_spec('cmifs_ros') is not None)
        if not has_package:
            raise CommandError(f'the cluster of {scheduler} has no worker: dask worker {scheduler}')
        if not all(has_package.values()):
            lacking = [worker for worker, has_it in has_package.items() if not has_it]
            raise CommandError(f'cmifs_ros is not installed on the worker {lacking[0]}')
        try:
            yield client
        except (CancelledError, KilledWorker) as error:
            what = ' '.join(str(error).split())
            raise CommandError(f'the cluster of {scheduler} broke down: {what}') from error


@contextmanager
def backend(scheduler: str | None) -> Iterator[None]:
    """Let joblib run on this machine, or on the cluster of a Dask scheduler.

    With a cluster of a single core, joblib runs everything on this machine.

    Raises
    ------
    CommandError
        If the cluster is unusable or breaks down.

    """
    if scheduler is None:
        # More threads than processes would only compete with each other.
        with joblib.parallel_config(backend='loky', inner_max_num_threads=1):
            yield
        return
    with connected(scheduler):
        if IS_OLD_JOBLIB:
            raise CommandError(
                f'--scheduler needs joblib 1.4 or newer; this is {joblib.__version__}'
            )
        with joblib.parallel_config(backend='dask'):
            yield
