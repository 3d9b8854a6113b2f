"""What the worker process does: a selection."""

from __future__ import annotations

from cmifs_ros.core.selection import Selection, select

from .worker import report_progress


def run_selection(episodes, channel_names, method: str, settings: dict, options: dict) -> Selection:
    """Return what `select` finds; tell the node how far it is."""
    return select(episodes, channel_names, method, settings, progress=report_progress, **options)
