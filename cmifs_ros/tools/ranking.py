# SPDX-License-Identifier: Apache-2.0

"""A ranking as a text table and as pictures."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cmifs_ros.collect.selection_report import (
    LINE_WIDTH,
    PREDICTED,
    interval,
    is_confirmed_earlier,
    prediction,
    reason,
    share,
    undecided_because,
)
from cmifs_ros.core.selection import Selection, SensorResult
from cmifs_ros.core.statuses import CONFIRMED, DISPENSABLE, UNDECIDED
from cmifs_ros.core.targets import DECISION
from cmifs_ros.core.words import listed

#: Most sensors or channels that a picture shows legibly.
MAX_SHOWN = 40
STATUS_COLORS = {CONFIRMED: '#1a7f37', UNDECIDED: '#9a6700', DISPENSABLE: '#6e7781'}
PLAIN_COLOR = '#0969da'
#: Which other sensors the score includes.
_TAKEN, _OTHERS = 'selected: with those ranked before', 'others: with all selected ones'


def figure_of(width: float, height: float):
    """Return a figure without pyplot: no window, no global state, nothing to close."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')


def label_of(name: str) -> str:
    """Return a name for a picture: short, without mathematics and control characters."""
    text = ''.join(c if c.isprintable() else '?' for c in name)
    return (text if len(text) <= 24 else f'{text[:10]}..{text[-12:]}').replace('$', r'\$')


def draw_ranking(selection: Selection):
    """Return a figure of what each sensor adds, with intervals; without a test, of the scores.

    Each sensor is a bar, the best at the top, in the colour of its status, with its p-value as
    text. A line shows the margin. Constant sensors are left out.
    """
    sensors = [sensor for sensor in selection.changing if sensor.effect is not None][:MAX_SHOWN]
    if not sensors:
        return draw_scores(selection)
    figure = figure_of(9, 1.6 + 0.26 * len(sensors))
    axes = figure.subplots()
    for status in dict.fromkeys(sensor.status for sensor in sensors):
        here = [i for i, sensor in enumerate(sensors) if sensor.status == status]
        shares = np.array([sensors[i].effect.share for i in here])
        low = np.array([sensors[i].effect.low for i in here])
        high = np.array([sensors[i].effect.high for i in here])
        axes.barh(
            here, 100 * shares, xerr=100 * np.array([shares - low, high - shares]), height=0.62,
            color=STATUS_COLORS[status], label=status, ecolor='0.2', capsize=2.5,
        )  # fmt: skip
    if selection.margin is not None:
        axes.axvline(
            100 * selection.margin, color='0.3', linestyle='--', linewidth=1,
            label=f'margin: {selection.margin:.0%}',
        )  # fmt: skip
    for place, sensor in enumerate(sensors):
        why = label_of(reason(selection, sensor))
        axes.text(
            1.01, place, f'p = {sensor.pvalue:.2g}' + (f', {why}' if why else ''),
            va='center', color='0.3', fontsize='small', transform=axes.get_yaxis_transform(),
        )  # fmt: skip
    axes.axvline(0, color='0.2', linewidth=0.8)
    axes.set_yticks(range(len(sensors)), [label_of(sensor.name) for sensor in sensors])
    for label, sensor in zip(axes.get_yticklabels(), sensors, strict=True):
        label.set_color(STATUS_COLORS[sensor.status])  # Bars may be too short to see.
    axes.set_ylim(len(sensors) - 0.4, -0.6)
    axes.set_xlabel(f'adds, in % of {variance_of(selection)} (with the 95 % interval)')
    axes.set_title(prediction(selection).replace('; ', ';\n'), loc='left', fontsize='medium')
    axes.legend()
    return figure


def variance_of(selection: Selection) -> str:
    """Return what the effects are shares of."""
    of = (
        'reward or of a next value' if selection.target == DECISION else PREDICTED[selection.target]
    )
    return f'the variance of the {of}'


def draw_scores(selection: Selection):
    """Return a figure of the scores over the null band.

    No line joins the scores: each is to be compared with the band at its own place. Constant
    sensors are left out.
    """
    sensors = selection.changing[:MAX_SHOWN]
    places = np.arange(len(sensors))
    figure = figure_of(9, 3.6)
    axes = figure.subplots()
    has_bands = all(sensor.null_band is not None for sensor in sensors)
    if sensors and has_bands:
        low, median, high = np.transpose([sensor.null_band for sensor in sensors])
        axes.fill_between(
            places, low, high, color='0.85', step='mid', label='null band: 5 % to 95 %'
        )
        axes.step(places, median, where='mid', color='0.6', label='its median')
    axes.plot(places, [sensor.score for sensor in sensors], 'o', color=PLAIN_COLOR, label='score')
    labels = [label_of(sensor.name) for sensor in sensors]
    axes.set_xticks(places, labels, rotation=45, ha='right', rotation_mode='anchor')
    axes.set_xlabel('sensor')
    axes.set_ylabel('score')
    count = sum(sensor.is_selected for sensor in sensors)
    if has_bands and 0 < count < len(sensors):
        axes.axvline(count - 0.5, color='0.4', linestyle=':')
        for place, side, text in ((0, 'left', _TAKEN), (1, 'right', _OTHERS)):
            axes.text(place, 1.01, text, ha=side, color='0.3', transform=axes.transAxes)
    if sensors:
        axes.legend()
    return figure


class Column(NamedTuple):
    """A column of the ranking: its heading, a cell for each sensor, and whether cells are text."""

    heading: str
    cells: list[str]
    is_text: bool = False


def columns_of(selection: Selection) -> list[Column]:
    """Return the leading columns: what each sensor adds and the evidence, or the score.

    Constant sensors are left out, here and in the further columns.
    """
    sensors = selection.changing
    effects = [sensor.effect for sensor in sensors]
    evidence = [
        Column('adds', ['' if e is None else share(e.share) for e in effects]),
        Column('95 % interval', ['' if e is None else interval(e) for e in effects]),
        Column('status', [s.status or '' for s in sensors], is_text=True),
        Column('p', ['' if s.pvalue is None else f'{s.pvalue:.2g}' for s in sensors]),
    ]
    return [
        Column('rank', [str(place) for place in range(1, len(sensors) + 1)]),
        Column('sensor', [s.name for s in sensors], is_text=True),
        *(_filled(evidence) or score_columns(selection)),
    ]


def further_columns(selection: Selection, most_names: int) -> list[Column]:
    """Return the columns of names, without empty columns.

    Parameters
    ----------
    selection : Selection
    most_names : int
        Greatest number of names in a cell.

    """
    sensors = selection.changing

    def listed_in(names: Sequence[str]) -> str:
        more = f' and {len(names) - most_names} more' if len(names) > most_names else ''
        return ', '.join(names[:most_names]) + more

    supporting = [listed_in(_supporting(sensor)) for sensor in sensors]
    stability = ['' if s.stability is None else f'{s.stability:.0%}' for s in sensors]
    return _filled(
        [
            Column(
                'why',
                [_remark(selection, sensor) for sensor in sensors],
                is_text=True,
            ),
            Column('stability', stability),
            Column('supporting channels', supporting, is_text=True),
            Column('redundant with', [listed_in(s.redundant_with) for s in sensors], is_text=True),
        ]
    )


def score_columns(selection: Selection) -> list[Column]:
    """Return the columns of the paper's score and its null band, if any."""
    bands = [sensor.null_band for sensor in selection.changing]
    return [
        Column('score', [f'{sensor.score:.3f}' for sensor in selection.changing]),
        *_filled([Column('null band', [f'{b[0]:.3f} to {b[2]:.3f}' if b else '' for b in bands])]),
    ]


def _remark(selection: Selection, sensor: SensorResult) -> str:
    if is_confirmed_earlier(selection, sensor):
        return 'confirmed earlier'
    return reason(selection, sensor) or undecided_because(selection, sensor)


def _supporting(sensor: SensorResult) -> tuple[str, ...]:
    # A sensor of one channel needs no list of channels.
    return () if sensor.supporting_channels == (sensor.name,) else sensor.supporting_channels


def _filled(columns: Sequence[Column]) -> list[Column]:
    return [column for column in columns if any(column.cells)]


def ranking_text(selection: Selection) -> str:
    """Return the ranking as a table, with warnings above and the predicted share below."""
    lines = [
        line
        for warning in selection.warnings
        for line in textwrap.wrap(f'warning: {warning}', LINE_WIDTH, subsequent_indent='  ')
    ]
    lines += [''] if lines else []
    padded = []
    for heading, cells, is_text in columns_of(selection) + further_columns(selection, 2):
        width = max(map(len, [heading, *cells]))
        align = str.ljust if is_text else str.rjust
        padded.append([align(cell, width) for cell in (heading, *cells)])
    lines += ['  '.join(row).rstrip() for row in zip(*padded, strict=True)]
    constant = [sensor.name for sensor in selection.sensors if sensor.is_constant]
    lines += [f'constant: {listed(constant)}'] if constant else []
    return '\n'.join([*lines, *textwrap.wrap(prediction(selection), LINE_WIDTH)])
