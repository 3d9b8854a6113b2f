"""A ranking as its readers see it: a table of text, and a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import listed

#: Sensors of the ranking, and channels beside the selected, that a picture can show legibly.
MAX_SHOWN = 40
_STATUS_COLORS = {'confirmed': '#1a7f37', 'tentative': '#b08800', 'rejected': '#8c959f'}
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


def num_taken(selection: Selection) -> int:
    """Return of how many sensors of the ranking each was scored with those before it.

    These are the selected; without evidence, which tells them from the rest, it is all.
    """
    names = set(selection.names)
    if not selection.supporting_channels:
        return len(selection.ranking) if names else 0
    return sum(bool(c) and names.issuperset(c) for c in selection.supporting_channels)


def draw_ranking(selection: Selection):
    """Return a figure of the scores, beside those of sensors that would tell nothing.

    No line joins the scores: each is one of its own, to be compared with the band at its place.
    Below are the p-values, which decide. Sensors that never changed are left out.
    """
    scores = selection.scores[: min(MAX_SHOWN, selection.num_live)]
    places = np.arange(len(scores))
    if selection.pvalues:
        figure = figure_of(9, 5)
        axes, of_pvalues = figure.subplots(2, sharex=True, height_ratios=(2, 1))
    else:
        figure = figure_of(9, 4)
        axes = of_pvalues = figure.subplots()
    if selection.null_scores:
        low, median, high = np.reshape(selection.null_scores[: len(scores)], (-1, 3)).T
        axes.fill_between(
            places, low, high, color='0.85', step='mid',
            label='a sensor that tells nothing: 5 % to 95 %',
        )  # fmt: skip
        axes.step(places, median, where='mid', color='0.6', label='its median')
    statuses = selection.statuses[: len(scores)] or ('',) * len(scores)
    for status in dict.fromkeys(statuses):
        here = [i for i, other in enumerate(statuses) if other == status]
        color = _STATUS_COLORS.get(status, PLAIN_COLOR)
        axes.plot(
            here, [scores[i] for i in here], 'o', color=color, zorder=3, label=status or 'score'
        )
        if selection.pvalues:
            pvalues = [max(selection.pvalues[i], _LEAST_PVALUE) for i in here]
            of_pvalues.plot(here, pvalues, 'o', color=color)
    if selection.pvalues:
        of_pvalues.set_yscale('log')
        of_pvalues.set_ylim(3, _LEAST_PVALUE / 3)
        of_pvalues.set_ylabel('p')
        of_pvalues.grid(axis='y', color='0.9')
    labels = [label_of(name) for name in selection.ranking[: len(scores)]]
    of_pvalues.set_xticks(places, labels, rotation=45, ha='right', rotation_mode='anchor')
    of_pvalues.set_xlabel('sensor')
    axes.set_ylabel('score')
    count = num_taken(selection)
    if 0 < count < len(scores):
        for part in figure.axes:
            part.axvline(count - 0.5, color='0.4', linestyle=':')
        for place, side, text in ((0, 'left', _TAKEN), (1, 'right', _OTHERS)):
            axes.text(place, 1.01, text, ha=side, color='0.3', transform=axes.transAxes)
    axes.legend()
    return figure


def _listed(names: Sequence[str]) -> str:
    more = f' and {len(names) - 2} more' if len(names) > 2 else ''
    return ', '.join(names[:2]) + more


def supporting_channels_of(selection: Selection) -> list[Sequence[str]]:
    """Return the supporting channels of each sensor, none where that is the sensor itself.

    Sensors that never changed have none and are left out.
    """
    pairs = zip(selection.ranking, selection.supporting_channels, strict=False)
    return [() if c == (name,) else c for name, c in pairs][: selection.num_live]


def ranking_text(selection: Selection) -> str:
    """Return the ranking as a table, with the evidence where there is any.

    `halves` is the share of random halves of the episodes in which the sensor is selected.
    """
    rows = [['rank', 'sensor', 'score']]
    rows[0] += ['tells nothing'] if selection.null_scores else []
    rows[0] += ['p'] if selection.pvalues else []
    rows[0] += ['status'] if selection.statuses else []
    rows[0] += ['halves'] if selection.stability else []
    supporting_channels = list(map(_listed, supporting_channels_of(selection)))
    rows[0] += ['supporting channels'] if any(supporting_channels) else []
    rows[0] += ['redundant with'] if any(selection.redundant_with) else []
    for i in range(selection.num_live):
        row = [str(i + 1), selection.ranking[i], f'{selection.scores[i]:.3f}']
        if selection.null_scores:
            low, _, high = selection.null_scores[i]
            row.append(f'{low:.3f} to {high:.3f}')
        row += [f'{selection.pvalues[i]:.2g}'] if selection.pvalues else []
        row += [selection.statuses[i]] if selection.statuses else []
        row += [f'{selection.stability[i]:.0%}'] if selection.stability else []
        row += [supporting_channels[i]] if any(supporting_channels) else []
        if any(selection.redundant_with):
            row.append(_listed(selection.redundant_with[i]))
        rows.append(row)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    is_text = [
        name in ('sensor', 'status', 'supporting channels', 'redundant with') for name in rows[0]
    ]
    lines = [
        '  '.join(
            cell.ljust(width) if left else cell.rjust(width)
            for cell, width, left in zip(row, widths, is_text, strict=True)
        ).rstrip()
        for row in rows
    ]
    constant = selection.ranking[selection.num_live :]
    lines += [f'never changed: {listed(constant)}'] if constant else []
    return '\n'.join(lines)
