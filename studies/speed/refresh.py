"""What a selection could save by keeping the widths and regularisations of the one before.

One episode has left and one has come. A refresh scores each set of channels at the grid points that
it had in the last full selection; a full selection searches the grid anew. Measured are the time
of both, how many of the grid points a full search would have moved, and whether the outcome is
the same.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from cmifs_ros.core import ConditionalMI, Episode, Lsmi
from cmifs_ros.core.held_out import HeldOutObjective
from cmifs_ros.core.search import forward_selection
from cmifs_ros.sim import SCENARIOS
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.program import exit_code
from studies.methods import DEFAULT_SETTINGS, default_criterion
from studies.tables import markdown_table
from studies.tasks import TASKS

from .benchmark import machine

#: The grid point of each step, for a set of channels.
Points = dict[tuple[int, ...], np.ndarray]


class RefreshedMI(ConditionalMI):
    """The criterion in float32, which searches the grid for sets of unknown grid points only.

    That is less than a refresh would have to do: to be exact it would decide in float64.
    """

    def __init__(self, episodes: Sequence[Episode], points: Points):
        super().__init__(episodes, Lsmi(), **DEFAULT_SETTINGS, random_state=0, executor=None)
        self.points = dict(points)

    def __call__(self, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        unknown = [subset for subset in subsets if tuple(subset) not in self.points]
        if unknown:
            screened = np.array([self._estimator.objective(s, unknown, None) for s in self._steps])
            averaged = np.tensordot(self._window, screened, axes=1)
            for i, subset in enumerate(unknown):
                picked = averaged[:, i].reshape(len(averaged), -1).argmin(axis=1)
                self.points[tuple(subset)] = picked
        widths, regularizations = map(
            np.array, (self._estimator.widths, self._estimator.regularizations)
        )
        scores = np.zeros(len(subsets))
        for n, (step, weight) in enumerate(zip(self._steps, self._weights, strict=True)):
            picked = np.array([self.points[tuple(subset)][n] for subset in subsets])
            which = picked[:, None] // len(regularizations) == np.arange(len(widths))
            objective = HeldOutObjective(step, subsets, regularizations, np.float32).evaluate(
                which, widths
            )
            values = objective.reshape(len(subsets), -1)[range(len(subsets)), picked]
            scores += weight * (-2 * values - 1)
        return scores


class Comparison(NamedTuple):
    """One exchange of an episode.

    Attributes
    ----------
    moved : float
        Share of the grid points that a full search puts elsewhere than the one before.
    stays : bool
        Whether the full selection is what it was before the exchange.
    agrees : bool
        Whether the refresh gives what the full selection gives.
    full, refresh : float
        Seconds.

    """

    moved: float
    stays: bool
    agrees: bool
    full: float
    refresh: float


def compare(episodes: Sequence[Episode], top: int) -> Comparison:
    """Rank the best of all episodes but the last, then of all but the first."""
    sensors = [(channel,) for channel in range(episodes[0].num_channels)]

    def ranked(criterion):
        start = time.perf_counter()
        ranking, _ = forward_selection(criterion, sensors, top)
        return ranking, time.perf_counter() - start

    before = RefreshedMI(episodes[:-1], {})
    ranking_before, _ = ranked(before)
    full, full_seconds = ranked(default_criterion(episodes[1:], seed=0))
    refresh, refresh_seconds = ranked(RefreshedMI(episodes[1:], before.points))
    after = RefreshedMI(episodes[1:], {})
    ranked(after)
    common = before.points.keys() & after.points.keys()
    moved = [before.points[subset] != after.points[subset] for subset in sorted(common)]
    return Comparison(
        float(np.mean(moved)),
        ranking_before == full,
        refresh == full,
        full_seconds,
        refresh_seconds,
    )


def run(options: argparse.Namespace) -> None:
    """Compare, then print."""
    found = []
    seeds = range(options.seed, options.seed + options.trials)
    for seed in tqdm(seeds, file=sys.stderr, disable=None):
        episodes = TASKS[options.scenario].rollout(options.episodes + 1, seed)
        found.append(compare(episodes, options.top))
    print(', '.join(f'{name} {value}' for name, value in machine().items()))
    print(
        f'{options.scenario}, {options.episodes} episodes of which one is exchanged, the best '
        f'{options.top} ranked, {options.trials} trials\n'
    )
    full, refresh = (np.median([getattr(c, kind) for c in found]) for kind in ('full', 'refresh'))
    ratio = np.median([c.refresh / c.full for c in found])
    rows = [
        ('grid points that a full search moves', f'{np.mean([c.moved for c in found]):.0%}'),
        ('exchanges that leave the selection as it was', sum(c.stays for c in found)),
        ('exchanges whose refresh gives the full selection', sum(c.agrees for c in found)),
        ('seconds of a full selection', f'{full:.3g}'),
        ('seconds of a refresh', f'{refresh:.3g}'),
        ('refresh / full', f'{ratio:.2f}'),
    ]
    print(markdown_table(('figure', f'of {options.trials}'), rows), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; a bad one ends the program with a sentence."""
    parser = argparse.ArgumentParser(
        prog='benchmark_refresh', description=' '.join(__doc__.split()), allow_abbrev=False
    )
    parser.add_argument('--scenario', choices=SCENARIOS, default='with_gravel')
    parser.add_argument('--episodes', type=number_from(2), default=100, help='default 100')
    parser.add_argument(
        '--top', type=number_from(1), default=4, help='how many channels to rank (default 4)'
    )
    parser.add_argument('--seed', type=number_from(0), default=0, help='default 0')
    parser.add_argument('--trials', type=number_from(1), default=20, help='default 20')
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Compare and print; return the exit code."""
    options = parse(arguments)
    return exit_code('benchmark_refresh', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
