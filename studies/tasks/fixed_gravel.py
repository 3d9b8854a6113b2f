# SPDX-License-Identifier: Apache-2.0

"""Another reading of the paper's world: gravel that is placed once."""

from __future__ import annotations

import numpy as np

from cmifs_ros.sim import GridWorld


class FixedGravelWorld(GridWorld):
    """The grid world with gravel in the same places in all episodes."""

    _first: np.ndarray | None = None

    def _lay_gravel(self) -> None:
        super()._lay_gravel()
        if self._first is None:
            self._first = self.gravel
        self.gravel = self._first
