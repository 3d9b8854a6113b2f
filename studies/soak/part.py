# SPDX-License-Identifier: Apache-2.0

"""What the loads and the faults have in common."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from studies.nodes.process import Process


class Part:
    """Something to be done to a selector; each public method yields rows of the table.

    Parameters
    ----------
    folder : Path
        For files and logs.
    scale : float
        1 for the full run; less takes as much less time.

    """

    def __init__(self, folder: Path, scale: float):
        self.folder = folder
        self.scale = scale

    def count(self, full: int) -> int:
        """Return a number of repetitions, of which there are fewer in a short run."""
        return max(1, round(full * self.scale))

    def bare(self, node: str, executor: str = 'chosen', **parameters) -> Process:
        """Start one of `bare_nodes`."""
        command = (sys.executable, '-m', 'studies.soak.bare_nodes', node, executor)
        return Process(self.folder, *command, **parameters)


def quantiles(latencies: np.ndarray) -> str:
    """Return p50 and p99 as text."""
    if not len(latencies):
        return 'nothing came in time'
    p50, p99 = np.percentile(latencies, (50, 99))
    return f'p50 {p50:.2f} ms, p99 {p99:.2f} ms'
