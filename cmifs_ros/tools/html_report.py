"""A selection as one HTML page that needs no network: pictures inside, no scripts."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from cmifs_ros.collect.selection_report import NOTHING_SELECTED
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted

from .ranking import (
    MAX_SHOWN,
    PLAIN_COLOR,
    STATUS_COLORS,
    columns_of,
    draw_ranking,
    figure_of,
    label_of,
)

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
       color: #1f2328; overflow-wrap: break-word; }
table { border-collapse: collapse; } td, th { padding: .2rem .8rem; text-align: left;
       border-bottom: 1px solid #d1d9e0; } td.number { text-align: right; white-space: nowrap; }
td.name { max-width: 16rem; }
img { max-width: 100%; } .note { color: #59636e; }
""" + ' '.join(f'.{status} {{ color: {color}; }}' for status, color in STATUS_COLORS.items())
#: So many names of channels or other sensors stand in a cell of the table.
_MAX_NAMES = 20

_READING_SCORES = 'The score is the criterion of the sensor with those taken before it.'
_READING = (
    'The score is what the return shares with the sensor and those selected before it; for a '
    'sensor that is not selected, with all that are. Grey is the null band: the scores that an '
    'uninformative sensor would have there. The score may fall from one sensor to the next, since '
    'more sensors are harder to learn from; that does no harm. p comes from a test of its own, '
    'which is sharper than the score. Confirmed: there is evidence. Tentative: the evidence is '
    'weak; more episodes may settle it. Rejected: no evidence that the sensor is informative '
    'beside the confirmed ones. Below the selected sensors come first those that are likely to '
    'be informative beside these and each other, then the rest by score, whatever their status.'
)


def write_report(
    folder: str | Path,
    selection: Selection,
    episodes: Sequence[Episode],
    names: Sequence[str],
    dropped: Mapping[str, int],
) -> Path:
    """Write a page about a selection and return its path, `folder`/index.html.

    Parameters
    ----------
    folder : str or pathlib.Path
        Made if it does not exist; a page that it holds is replaced.
    selection : Selection
    episodes : sequence of Episode
        Those that the selection rests on.
    names : sequence of str
        Of the channels of the episodes.
    dropped : mapping of str to int
        How many messages, steps or episodes were dropped, by cause.

    Raises
    ------
    ValueError
        If there are no episodes, or they have another number of channels than there are names.
    OSError
        If the folder or the page cannot be written.

    """
    if not episodes:
        raise ValueError('there are 0 episodes; expected those that the selection rests on')
    if episodes[0].num_channels != len(names):
        raise ValueError(
            f'there are {len(names)} names; expected {episodes[0].num_channels}, '
            'one for each channel of the episodes'
        )
    selected = ', '.join(selection.names) or f'nothing: {NOTHING_SELECTED}'
    states = np.concatenate([episode.states for episode in episodes])
    is_tested = any(sensor.pvalue is not None for sensor in selection.sensors)
    parts = [
        f'<h1>Selected: {escape(selected)}</h1>',
        f'<p>From {counted(selection.episodes, "episode")}, {counted(selection.steps, "step")}, '
        f'{counted(len(names), "channel")}, in {selection.seconds:.1f} s.</p>',
        '<h2>Ranking</h2>',
        f'<p class="note">{_READING if is_tested else _READING_SCORES}</p>',
        _image(draw_ranking(selection), 'score of each sensor of the ranking'),
        _ranking_table(selection),
        '<h2>Correlation of the selected with the other channels</h2>',
        '<p class="note">Of the values at all steps. A channel that correlates with a selected '
        'one may be left out because it says the same again.</p>',
        _correlation(selection, states, names),
        '<h2>Returns</h2>',
        _image(_draw_returns(episodes), 'histogram of the returns'),
        '<h2>Dropped</h2>',
        _dropped_table(dropped),
    ]
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f'<title>{escape(selected)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n'
        + '\n'.join(parts)
        + '\n</body>\n</html>\n'
    )
    path = Path(folder, 'index.html')
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name that came over the network may hold what no encoding has.
    path.write_text(page, encoding='utf-8', errors='replace')
    return path


def _image(figure, description: str) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=100)
    data = base64.b64encode(stream.getvalue()).decode('ascii')
    return f'<img alt="{escape(description)}" src="data:image/png;base64,{data}">'


def _ranking_table(selection: Selection) -> str:
    columns = columns_of(selection, _MAX_NAMES)
    rows = [f'<tr>{"".join(f"<th>{column.heading}</th>" for column in columns)}</tr>']
    for i in range(len(selection.changing)):
        cells = []
        for heading, values, is_text in columns:
            value = escape(values[i])
            kind = value if heading == 'status' else 'name' if is_text else 'number'
            cells.append(f'<td class="{kind}">{value}</td>')
        rows.append(f'<tr>{"".join(cells)}</tr>')
    constant = ', '.join(sensor.name for sensor in selection.sensors if sensor.is_constant)
    more = f'<p>Never changed, and so uninformative: {escape(constant)}</p>' if constant else ''
    return f'<table>{"".join(rows)}</table>{more}'


def _number(value) -> str:
    return f'<td class="number">{value}</td>'


def _correlation(selection: Selection, states: np.ndarray, names: Sequence[str]) -> str:
    selected = list(selection.indices)[:MAX_SHOWN]
    with np.errstate(invalid='ignore', over='ignore', divide='ignore'):
        centred = states - states.mean(axis=0)
        scaled = np.nan_to_num(centred / np.sqrt((centred**2).sum(axis=0)))
        correlation = scaled[:, selected].T @ scaled
    varies = np.ptp(states, axis=0) > 0
    others = [c for c in range(len(names)) if c not in selection.indices and varies[c]]
    if not selected or not others:
        return '<p>There are no two kinds to compare.</p>'
    # Of many, those that resemble a selected one most.
    likeness = np.abs(correlation[:, others]).max(axis=0)
    others = [others[i] for i in np.argsort(-likeness, kind='stable')[:MAX_SHOWN]]
    figure = figure_of(9, 1.6 + 0.35 * len(selected))
    axes = figure.subplots()
    image = axes.imshow(correlation[:, others], cmap='RdBu', vmin=-1, vmax=1, aspect='auto')
    axes.set_xticks(
        range(len(others)), [label_of(names[c]) for c in others], rotation=45, ha='right',
        rotation_mode='anchor',
    )  # fmt: skip
    axes.set_yticks(range(len(selected)), [label_of(names[c]) for c in selected])
    figure.colorbar(image, label='correlation')
    return _image(figure, 'correlation of the selected with the other channels')


def _draw_returns(episodes: Sequence[Episode]):
    returns = [float(episode.rewards.sum()) for episode in episodes]
    figure = figure_of(9, 3)
    axes = figure.subplots()
    axes.hist(returns, bins=min(30, max(5, len(returns) // 4)), color=PLAIN_COLOR)
    axes.set_xlabel('return (sum of the rewards of an episode)')
    axes.set_ylabel('episodes')
    return figure


def _dropped_table(dropped: Mapping[str, int]) -> str:
    rows = [
        f'<tr><td>{escape(cause)}</td>{_number(count)}</tr>'
        for cause, count in dropped.items()
        if count
    ]
    return f'<table>{"".join(rows)}</table>' if rows else '<p>Nothing was dropped.</p>'
