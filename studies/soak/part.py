# SPDX-License-Identifier: Apache-2.0

"""What the loads and the faults have in common."""

from pathlib import Path


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
