"""A ranking as its readers see it: a table of text, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cmifs_ros.core.selection import Selection
from cmifs_ros.core.statuses import CONFIRMED, REJECTED, TENTATIVE
from cmifs_ros.core.words import listed

#: Sensors of the ranking, and channels beside the selected, that a picture can show legibly.
MAX_SHOWN = 40
STATUS_COLORS = {CONFIRMED: '#1a7f37', TENTATIVE: '#9a6700', REJECTED: '#6e7781'}
PLAIN_COLOR = '#0969da'
#: Beside which others a sensor is scored.
_TAKEN, _OTHERS = 'selected: each with those before it', 'others: each with the selected alone'
#: Smaller p-values are drawn here; nobody takes them literally.
_LEAST_PVALUE = 1e-8


def figure_of(width: float, height: float):
    """Return a figure apart from pyplot: no window, no state, nothing to close."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')


def label_of(name: str) -> str:
    """Return a name as a picture can show it: short, no mathematics, no control characters."""
    text = ''.join(c if c.isprintable() else '?' for c in name)
    return (text if len(text) <= 24 else f'{text[:10]}..{text[-12:]}').replace('$', r'\$')


def draw_ranking(selection: Selection):
    """Return a figure of the scores over the null band.

    No line joins the scores: each is one of its own, to be compared with the band at its place.
    Below are the p-values, which decide. Sensors that never changed are left out.
    """
    sensors = selection.changing[:MAX_SHOWN]
    places = np.arange(len(sensors))
    is_tested = any(sensor.pvalue is not None for sensor in sensors)
    if is_tested:
        figure = figure_of(9, 5)
        axes, of_pvalues = figure.subplots(2, sharex=True, height_ratios=(2, 1))
        low, median, high = np.transpose([sensor.null_band for sensor in sensors])
        axes.fill_between(
            places, low, high, color='0.85', step='mid', label='null band: 5 % to 95 %'
        )
        axes.step(places, median, where='mid', color='0.6', label='its median')
    else:
        figure = figure_of(9, 4)
        axes = of_pvalues = figure.subplots()
    for status in dict.fromkeys(sensor.status for sensor in sensors):
        here = [i for i, sensor in enumerate(sensors) if sensor.status == status]
        color = STATUS_COLORS.get(status, PLAIN_COLOR)
        scores = [sensors[i].score for i in here]
        axes.plot(here, scores, 'o', color=color, zorder=3, label=status or 'score')
        if is_tested:
            pvalues = [max(sensors[i].pvalue, _LEAST_PVALUE) for i in here]
            of_pvalues.plot(here, pvalues, 'o', color=color)
    if is_tested:
        of_pvalues.set_yscale('log')
        of_pvalues.set_ylim(3, _LEAST_PVALUE / 3)
        of_pvalues.set_ylabel('p')
        of_pvalues.grid(axis='y', color='0.9')
    labels = [label_of(sensor.name) for sensor in sensors]
    of_pvalues.set_xticks(places, labels, rotation=45, ha='right', rotation_mode='anchor')
    of_pvalues.set_xlabel('sensor')
    axes.set_ylabel('score')
    count = sum(sensor.is_selected for sensor in sensors)
    if is_tested and 0 < count < len(sensors):
        for part in figure.axes:
            part.axvline(count - 0.5, color='0.4', linestyle=':')
        for place, side, text in ((0, 'left', _TAKEN), (1, 'right', _OTHERS)):
            axes.text(place, 1.01, text, ha=side, color='0.3', transform=axes.transAxes)
    if sensors:
        axes.legend()
    return figure


class Column(NamedTuple):
    """A column of the ranking: heading, a cell for each sensor, whether that is text."""

    heading: str
    cells: list[str]
    is_text: bool = False


def columns_of(selection: Selection, most_names: int) -> list[Column]:
    """Return the columns of the ranking, without those that hold nothing.

    Parameters
    ----------
    selection : Selection
        Its sensors that never changed are left out.
    most_names : int
        So many names of channels or other sensors stand in a cell.

    """
    sensors = selection.changing

    def listed_in(names: Sequence[str]) -> str:
        more = f' and {len(names) - most_names} more' if len(names) > most_names else ''
        return ', '.join(names[:most_names]) + more

    # The channel that is the sensor itself says nothing more.
    supporting = [
        () if s.supporting_channels == (s.name,) else s.supporting_channels for s in sensors
    ]
    bands = [sensor.null_band for sensor in sensors]
    found = [
        Column('null band', [f'{b[0]:.3f} to {b[2]:.3f}' if b else '' for b in bands]),
        Column('p', ['' if s.pvalue is None else f'{s.pvalue:.2g}' for s in sensors]),
        Column('status', [s.status or '' for s in sensors], is_text=True),
        Column('stability', ['' if s.stability is None else f'{s.stability:.0%}' for s in sensors]),
        Column('supporting channels', list(map(listed_in, supporting)), is_text=True),
        Column('redundant with', [listed_in(s.redundant_with) for s in sensors], is_text=True),
    ]
    return [
        Column('rank', [str(place) for place in range(1, len(sensors) + 1)]),
        Column('sensor', [s.name for s in sensors], is_text=True),
        Column('score', [f'{s.score:.3f}' for s in sensors]),
        *(column for column in found if any(column.cells)),
    ]


def ranking_text(selection: Selection) -> str:
    """Return the ranking as a table, with the evidence where there is any."""
    padded = []
    for heading, cells, is_text in columns_of(selection, most_names=2):
        width = max(map(len, [heading, *cells]))
        align = str.ljust if is_text else str.rjust
        padded.append([align(cell, width) for cell in (heading, *cells)])
    lines = ['  '.join(row).rstrip() for row in zip(*padded, strict=True)]
    constant = [sensor.name for sensor in selection.sensors if sensor.is_constant]
    lines += [f'never changed: {listed(constant)}'] if constant else []
    return '\n'.join(lines)
