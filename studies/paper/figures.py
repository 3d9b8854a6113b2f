# SPDX-License-Identifier: Apache-2.0

"""Figures 6 and 7 of Hachiya & Sugiyama (2010), and the numbers in them as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from studies.tasks.registry import TASKS
from studies.trials.tables import markdown_table
from studies.trials.trial import Results, Trial

NUM_FEATURES = 14
#: The feature of Figure 7, s(4): the gravel sensor.
GRAVEL = 3
#: Contents of each figure.
SCENARIOS = {'6a': 'without_gravel', '6b': 'with_gravel', '7': 'with_gravel'}
#: The paper's baseline, its method, and this package's default, in the order of the figures.
LABELS = {
    'kdr': 'KDR-based',
    'paper': "proposed, as in the paper ('paper')",
    'default': 'proposed, our default',
}
COLORS = {'kdr': 'tab:orange', 'paper': 'tab:blue', 'default': 'tab:green'}
MARKERS = {'kdr': 's', 'paper': 'o', 'default': '^'}


def plan(
    figures: Sequence[str], methods: Sequence[str], episodes: Sequence[int], trials: int, seed: int
) -> list[Trial]:
    """Return the trials that some figures need, each once.

    Figure 7 shows the greatest number of episodes. Repetition i has the seed `seed` + i.
    Repetitions run one after the other, so that progress predicts the remaining time.
    """
    wanted = {'without_gravel': set(), 'with_gravel': set()}
    for figure in figures:
        wanted[SCENARIOS[figure]] |= {max(episodes)} if figure == '7' else set(episodes)
    return [
        Trial(scenario, method, count, number, seed + number)
        for number in range(trials)
        for scenario, counts in wanted.items()
        for count in sorted(counts)
        for method in methods
    ]


def gravel_histogram(results: Results, method: str, episodes: int) -> np.ndarray:
    """Return how often s(4) has rank 1, 2, ..., 14 with gravel: shape (14,)."""
    ranks = [o.rank(GRAVEL) for o in results.of('with_gravel', method, episodes)]
    return np.bincount(ranks, minlength=NUM_FEATURES + 1)[1:]


def save_figures(results: Results, figures: Sequence[str], folder: Path) -> list[Path]:
    """Save each figure as PNG and PDF; return the files."""
    paths = []
    for name in figures:
        figure = _histograms(results) if name == '7' else _rank_sums(results, SCENARIOS[name])
        for suffix in ('png', 'pdf'):
            paths.append(folder / f'figure_{name}.{suffix}')
            figure.savefig(paths[-1], dpi=150)
    return paths


def _rank_sums(results: Results, scenario: str) -> Figure:
    figure = Figure(figsize=(5, 4), layout='constrained')
    axes = figure.subplots()
    episodes = results.episodes(scenario)
    for method in _methods(results):
        means, errors = zip(*(results.rank_sum(scenario, method, m) for m in episodes), strict=True)
        axes.errorbar(
            episodes,
            means,
            errors,
            color=COLORS[method],
            marker=MARKERS[method],
            capsize=3,
            label=LABELS[method],
        )
    axes.axhline(TASKS[scenario].optimum, color='gray', linestyle=':', label='optimum')
    axes.set_xlabel('number of episodes')
    axes.set_ylabel('sum of ranks of the relevant features')
    axes.set_title(scenario.replace('_', ' '))
    axes.legend()
    return figure


def _histograms(results: Results) -> Figure:
    methods = _methods(results)
    figure = Figure(figsize=(4 * len(methods), 3.4), layout='constrained')
    panels = figure.subplots(1, len(methods), sharey=True, squeeze=False)[0]
    episodes = results.episodes('with_gravel')[-1]
    ranks = np.arange(1, NUM_FEATURES + 1)
    for axes, method in zip(panels, methods, strict=True):
        axes.bar(ranks, gravel_histogram(results, method, episodes), color=COLORS[method])
        axes.set_xticks(ranks)
        axes.set_xlabel(f'rank of s(4), {episodes} episodes')
        axes.set_title(LABELS[method])
    panels[0].set_ylabel('trials')
    return figure


def markdown(results: Results, figures: Sequence[str]) -> str:
    """Return the numbers of the figures as Markdown tables."""
    return '\n'.join(
        _histogram_table(results) if name == '7' else _rank_sum_table(results, name)
        for name in figures
    )


def _methods(results: Results) -> list[str]:
    return [method for method in LABELS if method in results.methods]


def _rank_sum_table(results: Results, figure: str) -> str:
    scenario, methods = SCENARIOS[figure], _methods(results)
    rows = [
        (
            episodes,
            len(results.of(scenario, methods[0], episodes)),
            *('{:.2f} ± {:.2f}'.format(*results.rank_sum(scenario, m, episodes)) for m in methods),
        )
        for episodes in results.episodes(scenario)
    ]
    return (
        f'## Figure {figure}: rank sum of the relevant features, {scenario.replace("_", " ")}\n\n'
        f'Mean and standard error; the optimum is {TASKS[scenario].optimum}.\n\n'
        + markdown_table(('episodes', 'trials', *(LABELS[m] for m in methods)), rows)
    )


def _histogram_table(results: Results) -> str:
    episodes = results.episodes('with_gravel')[-1]
    rows = []
    for method in _methods(results):
        counts = gravel_histogram(results, method, episodes)
        shares = (counts[1:5].sum() / counts.sum(), counts[7:].sum() / counts.sum())
        rows.append((LABELS[method], *counts, *(f'{share:.0%}' for share in shares)))
    return (
        f'## Figure 7: rank of s(4) with gravel at {episodes} episodes, number of trials\n\n'
        + markdown_table(
            ('method', *range(1, NUM_FEATURES + 1), 'within 2 to 5', '8 or worse'), rows
        )
    )
