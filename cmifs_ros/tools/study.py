"""The experiment of Hachiya & Sugiyama (2010), Section 4: its trials, and how one is run.

A module of its own, so that processes and machines that run trials can import it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from cmifs_ros.core import ConditionalMISelector, KDRSelector
from cmifs_ros.sim import channel_names, rollout

#: The features that should rank first: s(1) and s(2); with gravel also s(3) and s(4).
RELEVANT = {'without_gravel': (0, 1), 'with_gravel': (0, 1, 2, 3)}
#: The feature of Figure 7, s(4), which senses gravel.
GRAVEL = 3
#: The method of the paper, the one it compares with, and the default of this package.
METHODS = ('paper', 'kdr', 'default')
#: The figures that show the trials of a scenario.
FIGURES = {'without_gravel': ('6a',), 'with_gravel': ('6b', '7')}


class Trial(NamedTuple):
    """One ranking of all 14 features.

    Attributes
    ----------
    scenario : {'without_gravel', 'with_gravel'}
    method : {'paper', 'kdr', 'default'}
    episodes : int
        The first so many episodes of `rollout(scenario, ..., seed)`: those of a smaller trial
        are among those of a larger one.
    number : int
        Which of the repetitions it is, from 0.
    seed : int
        Of the episodes and of everything random in the method.

    """

    scenario: str
    method: str
    episodes: int
    number: int
    seed: int


class Outcome(NamedTuple):
    """What a trial gave: indices of the features from 0, best first, and the computing time."""

    trial: Trial
    ranking: tuple[int, ...]
    seconds: float

    def rank(self, feature: int) -> int:
        """Return the rank of a feature, from 1."""
        return self.ranking.index(feature) + 1

    @property
    def rank_sum(self) -> int:
        """Sum of the ranks of the relevant features, the ordinate of Figure 6."""
        return sum(self.rank(feature) for feature in RELEVANT[self.trial.scenario])


def plan(
    figures: Sequence[str], methods: Sequence[str], episodes: Sequence[int], trials: int, seed: int
) -> list[Trial]:
    """Return the trials that some figures need, each once.

    Figure 7 shows the greatest number of episodes. Repetition i has the seed `seed` + i. The
    repetitions follow each other, so that a study under way tells how long the rest takes.
    """
    wanted = {'without_gravel': set(), 'with_gravel': set()}
    if '6a' in figures:
        wanted['without_gravel'] |= set(episodes)
    if '6b' in figures:
        wanted['with_gravel'] |= set(episodes)
    if '7' in figures:
        wanted['with_gravel'].add(max(episodes))
    return [
        Trial(scenario, method, count, number, seed + number)
        for number in range(trials)
        for scenario, counts in wanted.items()
        for count in sorted(counts)
        for method in methods
    ]


def run_trial(trial: Trial) -> Outcome:
    """Rank the features once; the same trial gives the same ranking wherever it runs."""
    episodes = rollout(trial.scenario, trial.episodes, trial.seed)
    if trial.method == 'kdr':
        # The reward depends on s(1) directly, as the paper tells its rival.
        selector = KDRSelector(target='x', random_state=trial.seed)
    elif trial.method == 'paper':
        selector = ConditionalMISelector.paper(random_state=trial.seed)
    else:
        selector = ConditionalMISelector(random_state=trial.seed)
    start = time.perf_counter()
    selector.fit(episodes, names=channel_names(trial.scenario))
    return Outcome(trial, tuple(selector.ranking_.tolist()), time.perf_counter() - start)
