# SPDX-License-Identifier: Apache-2.0

"""A graph of why a decision needs its sensors."""

from __future__ import annotations

from cmifs_ros.collect.selection_report import predicted_by, reason
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.targets import REWARD

from .ranking import MAX_SHOWN, STATUS_COLORS, figure_of, label_of

_REWARD_COLOR = '#0969da'


def draw_reasons(selection: Selection):
    """Return a figure of arrows from each sensor to what it predicts, up to the reward.

    The reward is on the right; to the left of it, column by column, are the sensors that are needed
    for those to their right. Sensors that only predict each other are leftmost. None if there are
    no sensors.
    """
    sensors = [s for s in selection.sensors if reason(selection, s)][:MAX_SHOWN]
    if not sensors:
        return None
    leads_to = {s.name: predicted_by(selection, s) for s in sensors}
    columns = {s.name: _steps_to_reward(s.name, leads_to) for s in sensors}
    last = max([c for c in columns.values() if c is not None], default=0) + 1
    columns = {name: last if column is None else column for name, column in columns.items()}
    by_column: dict[int, list[str]] = {}
    for name, column in columns.items():
        by_column.setdefault(column, []).append(name)
    rows = max(map(len, by_column.values()))
    figure = figure_of(9, 0.8 + 0.5 * rows)
    axes = figure.subplots()
    places = {
        name: (-column, (i + 1) / (len(names) + 1))
        for column, names in by_column.items()
        for i, name in enumerate(names)
    }
    status = {sensor.name: sensor.status for sensor in sensors}
    box = {'boxstyle': 'round', 'facecolor': 'white'}
    reward = axes.text(
        0, 0.5, REWARD, ha='center', va='center', bbox=box | {'edgecolor': _REWARD_COLOR}
    )
    boxes = {None: reward} | {
        name: axes.text(
            *place, label_of(name), ha='center', va='center',
            bbox=box | {'edgecolor': STATUS_COLORS[status[name]]},
        )
        for name, place in places.items()
    }  # fmt: skip
    for name, other in leads_to.items():
        if other is None or other in boxes:
            axes.annotate(
                '', xy=(0, 0.5) if other is None else places[other], xytext=places[name],
                arrowprops={
                    'arrowstyle': '->', 'color': '0.4', 'patchA': boxes[name].get_bbox_patch(),
                    'patchB': boxes[other].get_bbox_patch(), 'connectionstyle': 'arc3,rad=0.12',
                },
            )  # fmt: skip
    axes.set_xlim(-max(columns.values()) - 0.5, 0.5)
    axes.set_ylim(0, 1)
    axes.set_axis_off()
    return figure


def _steps_to_reward(name: str, leads_to: dict[str, str | None]) -> int | None:
    """Return the number of arrows from a sensor to the reward; None if there is no path."""
    seen: list[str] = []
    while name not in seen and name in leads_to:
        seen.append(name)
        if leads_to[name] is None:
            return len(seen)
        name = leads_to[name]
    return None
