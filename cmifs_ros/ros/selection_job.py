"""What the worker process does: a selection, shared with further processes if so asked."""

from __future__ import annotations

import functools
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

from cmifs_ros.core.selection import Selection, select

from .worker import end_with_parent, report_progress


def run_selection(episodes, channel_names, method: str, settings: dict, cores: int) -> Selection:
    """Return `select(episodes, channel_names, method, settings)`, computed on several cores.

    'kdr' takes one, whatever is asked for.
    """
    if method == 'conditional_mi' and cores > 1:
        settings = settings | {'executor': _processes(cores)}
    return select(episodes, channel_names, method, settings, progress=report_progress)


@functools.lru_cache(maxsize=1)
def _processes(count: int) -> ProcessPoolExecutor:
    """Return processes that are kept for the next selection; another number ends them."""
    return ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context('spawn'), initializer=end_with_parent
    )
