# SPDX-License-Identifier: Apache-2.0

"""A selection as one self-contained HTML page: pictures embedded, no scripts, no network."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from cmifs_ros.collect.advice import Advice, Item, advice_of, headed, text_of
from cmifs_ros.collect.example_frames import ExampleFrame
from cmifs_ros.collect.selection_report import nothing_selected, prediction
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.targets import DECISION
from cmifs_ros.core.thinning import ThinnedEpisodes
from cmifs_ros.core.words import counted

from .frame_gallery import embedded, gallery
from .ranking import (
    MAX_SHOWN,
    PLAIN_COLOR,
    STATUS_COLORS,
    columns_of,
    draw_ranking,
    draw_scores,
    figure_of,
    further_columns,
    label_of,
    score_columns,
    variance_of,
)
from .reason_graph import draw_reasons

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
       color: #1f2328; overflow-wrap: break-word; }
table { border-collapse: collapse; } td, th { padding: .2rem .8rem; text-align: left;
       border-bottom: 1px solid #d1d9e0; } td.number { text-align: right; white-space: nowrap; }
td.name { max-width: 16rem; }
img { max-width: 100%; } .frames { display: flex; flex-wrap: wrap; } figure { margin: .4rem; }
figcaption, .note { color: #59636e; }
.warning { background: #fff8c5; border: 1px solid #d4a72c; padding: .4rem .8rem; }
""" + ' '.join(f'.{status} {{ color: {color}; }}' for status, color in STATUS_COLORS.items())
#: Names of channels or sensors in a cell of the table.
_MAX_NAMES = 20

_READING = (
    'What a sensor adds is the share of {variance} that it predicts beyond the selected ones. The '
    'interval contains the true share in 95 of 100 cases. The share is an estimate, which may be '
    'below 0 by chance; whether a sensor matters is decided by p. Confirmed: there is evidence '
    'that the sensor is informative given the other selected ones. p comes from a separate test, '
    'which is more sensitive than the share, so a sensor may be confirmed but add little. '
    'Dispensable: there is no such evidence, and with 95 % confidence the sensor adds less than '
    '{margin:.0%}; this bound is one-sided, so the interval may reach a little further. '
    'Undecided: neither; more episodes may settle it. All sensors together may predict less than '
    'the selected ones, because each uninformative sensor makes the prediction harder to learn.'
)
_READING_WHY = (
    ' Why: the reward depends on the sensor, or the sensor predicts the next value of another '
    'sensor that is needed, and so on up to the reward.'
)
_READING_SCORES = 'The score is that of the sensor together with those ranked before it.'
_READING_BAND = (
    'The score ranks sensors; it is not evidence. It is the mutual information of the target with '
    'the sensor and those selected before it; for a sensor that is not selected, with all selected '
    'ones. Grey is the null band: the scores of an uninformative sensor at that place. More '
    'sensors are harder to learn from, so the score may fall from one sensor to the next. A '
    'confirmed sensor may have a score within the band; its p-value comes from a more sensitive '
    'test.'
)
_READING_ADVICE = (
    'Dispensable sensors can go as long as the others are kept. A topic can go if all its channels '
    'can.'
)


def write_report(
    folder: str | Path,
    selection: Selection,
    episodes: ThinnedEpisodes | None = None,
    names: Sequence[str] = (),
    dropped: Mapping[str, int | str] | None = None,
    *,
    advice: Advice | None = None,
    frames: Mapping[str, Sequence[ExampleFrame]] | None = None,
) -> Path:
    """Write a page about a selection and return its path, `folder`/index.html.

    Parameters
    ----------
    folder : str or pathlib.Path
        Created if it does not exist; an existing page is replaced.
    selection : Selection
    episodes : ThinnedEpisodes, optional
        Those of the selection. Without them there are no correlations and no returns.
    names : sequence of str, optional
        Names of their channels.
    dropped : mapping of str to int or str, optional
        Numbers of dropped messages, steps or episodes by cause.
    advice : Advice, optional
        Advice by topic; by default, by sensor.
    frames : mapping of str to sequence of ExampleFrame, optional
        By camera, those at which it matters most.

    Raises
    ------
    ValueError
        If the numbers of channels and names differ.
    OSError
        If the folder or the page cannot be written.

    """
    if episodes and episodes.num_channels != len(names):
        raise ValueError(
            f'there are {len(names)} names; expected {episodes.num_channels}, '
            'one for each channel of the episodes'
        )
    selected = ', '.join(selection.selected) or f'nothing: {nothing_selected(selection)}'
    sizes = [counted(selection.episodes, 'episode'), counted(selection.steps, 'step')]
    sizes += [counted(len(names), 'channel')] if names else []
    warnings = [*selection.warnings, *filter(None, [selection.doubt])]
    parts = [
        f'<h1>Selected: {escape(selected)}</h1>',
        *(f'<p class="warning">{escape(text)}</p>' for text in warnings),
        f'<p>From {", ".join(sizes)}, in {selection.seconds:.1f} s.</p>',
        '<h2>What each sensor adds</h2>' if _is_tested(selection) else '<h2>Ranking</h2>',
        _image(draw_ranking(selection), f'ranking: {prediction(selection)}'),
        _ranking_table(selection),
        _reading(selection),
        _reasons(selection),
        *(gallery(name, of_camera) for name, of_camera in (frames or {}).items() if of_camera),
        _scores(selection),
        _data(selection, episodes, names) if episodes else '',
        '<h2>Dropped</h2>',
        _dropped_table(dropped or {}),
        _advice(advice_of(selection) if advice is None else advice),
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
    # A name from the network may have characters that cannot be encoded.
    path.write_text(page, encoding='utf-8', errors='replace')
    return path


def _is_tested(selection: Selection) -> bool:
    return any(sensor.pvalue is not None for sensor in selection.sensors)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _reading(selection: Selection) -> str:
    if not _is_tested(selection):
        return f'<p class="note">{_READING_SCORES}</p>'
    text = _READING.format(variance=variance_of(selection), margin=selection.margin or 0.0)
    text += _READING_WHY if selection.target == DECISION else ''
    return f'<p class="note">{text}</p>'


def _reasons(selection: Selection) -> str:
    figure = draw_reasons(selection) if selection.target == DECISION else None
    return '' if figure is None else _image(figure, 'what each sensor is needed for')


def _scores(selection: Selection) -> str:
    """Return the paper's scores with their null band, unless they are the ranking itself."""
    if not _is_tested(selection):
        return ''
    picture = _image(draw_scores(selection), 'score of each sensor of the ranking')
    return f'<h2>The score of the paper</h2><p class="note">{_READING_BAND}</p>{picture}'


def _advice(advice: Advice) -> str:
    """Return the three lists of the advice; empty if there is none."""
    found = headed(advice)
    lists = [f'<h3>{escape(_sentence(heading))}</h3>{_list(items)}' for heading, items in found]
    if not found:
        return ''
    reading = f'<p class="note">{advice.scope} {_READING_ADVICE}</p>'
    hints = ''.join(f'<p>{escape(hint)}</p>' for hint in advice.hints)
    return f'<h2>What to keep, and what can go</h2>{reading}{"".join(lists)}{hints}'


def _list(items: Sequence[Item]) -> str:
    points = ''.join(f'<li>{escape(text_of(item))}</li>' for item in items)
    return f'<ul>{points}</ul>' if points else '<p>Nothing.</p>'


def _image(figure, description: str) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=100)
    return embedded(stream.getvalue(), description)


def _ranking_table(selection: Selection) -> str:
    columns = columns_of(selection) + further_columns(selection, _MAX_NAMES)
    columns += score_columns(selection) if _is_tested(selection) else []
    rows = [f'<tr>{"".join(f"<th>{column.heading}</th>" for column in columns)}</tr>']
    for i in range(len(selection.changing)):
        cells = []
        for heading, values, is_text in columns:
            value = escape(values[i])
            kind = value if heading == 'status' else 'name' if is_text else 'number'
            cells.append(f'<td class="{kind}">{value}</td>')
        rows.append(f'<tr>{"".join(cells)}</tr>')
    constant = ', '.join(sensor.name for sensor in selection.sensors if sensor.is_constant)
    more = f'<p>Constant, and therefore uninformative: {escape(constant)}</p>' if constant else ''
    return f'<table>{"".join(rows)}</table>{more}'


def _data(selection: Selection, episodes: ThinnedEpisodes, names: Sequence[str]) -> str:
    """Return the parts about the episodes themselves."""
    return (
        '<h2>Correlation of the selected with the other channels</h2>'
        '<p class="note">Over the steps used. A channel that correlates with a selected one '
        'may have been left out because it is redundant.</p>'
        + _correlation(selection, episodes.samples.states, names)
        + '<h2>Returns</h2>'
        + _image(_draw_returns(episodes.totals), 'histogram of the returns')
    )


def _correlation(selection: Selection, states: np.ndarray, names: Sequence[str]) -> str:
    selected = list(selection.indices)[:MAX_SHOWN]
    with np.errstate(invalid='ignore', over='ignore', divide='ignore'):
        centred = states - states.mean(axis=0)
        scaled = np.nan_to_num(centred / np.sqrt((centred**2).sum(axis=0)))
        correlation = scaled[:, selected].T @ scaled
    varies = np.ptp(states, axis=0) > 0
    others = [c for c in range(len(names)) if c not in selection.indices and varies[c]]
    if not selected or not others:
        return '<p>There is nothing to compare.</p>'
    # Of many, those that correlate most with a selected one.
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


def _draw_returns(returns: np.ndarray):
    figure = figure_of(9, 3)
    axes = figure.subplots()
    axes.hist(returns, bins=min(30, max(5, len(returns) // 4)), color=PLAIN_COLOR)
    axes.set_xlabel('return (sum of the rewards of an episode)')
    axes.set_ylabel('episodes')
    return figure


def _dropped_table(dropped: Mapping[str, int | str]) -> str:
    rows = [
        f'<tr><td>{escape(cause)}</td><td class="number">{count}</td></tr>'
        for cause, count in dropped.items()
        if count
    ]
    return f'<table>{"".join(rows)}</table>' if rows else '<p>Nothing was dropped.</p>'
