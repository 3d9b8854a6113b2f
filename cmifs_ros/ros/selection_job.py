# SPDX-License-Identifier: Apache-2.0

"""The work of the worker process: a selection."""

from __future__ import annotations

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selecting import select
from cmifs_ros.core.selection import Selection

from .worker import report_progress


def run_selection(episodes, channel_names, method: str, settings: dict, options: dict) -> Selection:
    """Run `select`, reporting its progress to the node."""
    return select(episodes, channel_names, method, settings, progress=report_progress, **options)


def prepare() -> None:
    """Make a tiny selection, so that all compiled code is loaded."""
    rng = np.random.default_rng(0)
    episodes = [Episode(rng.normal(size=(3, 2)), [0, 0, i]) for i in range(4)]
    select(episodes, ('a', 'b'), 'conditional_mi', {})
