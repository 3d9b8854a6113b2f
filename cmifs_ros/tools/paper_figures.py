"""Figures 6 and 7 of Hachiya & Sugiyama (2010), and the numbers in them as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .study import GRAVEL, RELEVANT, Outcome

NUM_FEATURES = 14
SCENARIOS = {'6a': 'without_gravel', '6b': 'with_gravel', '7': 'with_gravel'}
LABELS = {
    'kdr': 'KDR-based',
    'paper': "proposed, as in the paper ('paper')",
    'default': 'proposed, our default',
}
COLORS = {'kdr': 'tab:orange', 'paper': 'tab:blue', 'default': 'tab:green'}
MARKERS = {'kdr': 's', 'paper': 'o', 'default': '^'}


class Results:
    """The outcomes of a study, sorted by what the figures show.

    Nothing here depends on the order in which the trials finished.
    """

    def __init__(self, outcomes: Iterable[Outcome]):
        self._outcomes = sorted(outcomes)
        present = {outcome.trial.method for outcome in self._outcomes}
        #: The methods there are, in the order of the figures.
        self.methods = [method for method in LABELS if method in present]

    def episodes(self, scenario: str) -> list[int]:
        """Return the numbers of episodes there are trials of."""
        return sorted({o.trial.episodes for o in self._outcomes if o.trial.scenario == scenario})

    def of(self, scenario: str, method: str, episodes: int) -> list[Outcome]:
        """Return the trials of one point of a figure."""
        return [o for o in self._outcomes if o.trial[:3] == (scenario, method, episodes)]

    def rank_sum(self, scenario: str, method: str, episodes: int) -> tuple[float, float]:
        """Return mean and standard error of the rank sum; one trial has an error of 0."""
        sums = np.array([o.rank_sum for o in self.of(scenario, method, episodes)], dtype=float)
        if len(sums) == 1:
            return sums[0], 0.0
        return sums.mean(), sums.std(ddof=1) / np.sqrt(len(sums))

    def gravel_histogram(self, method: str, episodes: int) -> np.ndarray:
        """Return how often s(4) has rank 1, 2, ..., 14 with gravel: shape (14,)."""
        ranks = [o.rank(GRAVEL) for o in self.of('with_gravel', method, episodes)]
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
    for method in results.methods:
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
    axes.axhline(_optimum(scenario), color='gray', linestyle=':', label='optimum')
    axes.set_xlabel('number of episodes')
    axes.set_ylabel('sum of ranks of the relevant features')
    axes.set_title(scenario.replace('_', ' '))
    axes.legend()
    return figure


def _histograms(results: Results) -> Figure:
    figure = Figure(figsize=(4 * len(results.methods), 3.4), layout='constrained')
    panels = figure.subplots(1, len(results.methods), sharey=True, squeeze=False)[0]
    episodes = results.episodes('with_gravel')[-1]
    ranks = np.arange(1, NUM_FEATURES + 1)
    for axes, method in zip(panels, results.methods, strict=True):
        axes.bar(ranks, results.gravel_histogram(method, episodes), color=COLORS[method])
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


def _rank_sum_table(results: Results, figure: str) -> str:
    scenario = SCENARIOS[figure]
    lines = [
        f'## Figure {figure}: rank sum of the relevant features, {scenario.replace("_", " ")}',
        '',
        f'Mean and standard error; the optimum is {_optimum(scenario)}.',
        '',
        *_head('episodes', 'trials', *(LABELS[method] for method in results.methods)),
    ]
    for episodes in results.episodes(scenario):
        cells = [
            '{:.2f} ± {:.2f}'.format(*results.rank_sum(scenario, method, episodes))
            for method in results.methods
        ]
        trials = len(results.of(scenario, results.methods[0], episodes))
        lines.append(_row(episodes, trials, *cells))
    return '\n'.join(lines) + '\n'


def _histogram_table(results: Results) -> str:
    episodes = results.episodes('with_gravel')[-1]
    lines = [
        f'## Figure 7: rank of s(4) with gravel at {episodes} episodes, number of trials',
        '',
        *_head('method', *range(1, NUM_FEATURES + 1), 'within 2 to 5', '8 or worse'),
    ]
    for method in results.methods:
        counts = results.gravel_histogram(method, episodes)
        shares = (counts[1:5].sum() / counts.sum(), counts[7:].sum() / counts.sum())
        lines.append(_row(LABELS[method], *counts, *(f'{share:.0%}' for share in shares)))
    return '\n'.join(lines) + '\n'


def _head(*cells) -> list[str]:
    return [_row(*cells), _row(*('---' for _ in cells))]


def _row(*cells) -> str:
    return f'| {" | ".join(map(str, cells))} |'


def _optimum(scenario: str) -> int:
    return sum(range(1, len(RELEVANT[scenario]) + 1))
