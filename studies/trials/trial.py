# SPDX-License-Identifier: Apache-2.0

"""Trials: a method ranks the channels of a task, and its result.

A separate module, so that processes and machines that run trials can import it.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable
from typing import NamedTuple

from studies.methods.registry import rank
from studies.tasks.registry import TASKS

from .statistics import mean_and_error, rank_sum


class Trial(NamedTuple):
    """One ranking of all channels.

    Attributes
    ----------
    scenario : str
        One of `TASKS`, or a world of the study's own.
    method : str
        One of `METHODS`, or a question of the study's own.
    episodes : int
        Number of episodes that the task rolls out from the seed; a smaller trial has the first
        ones of a larger one.
    number : int
        Number of the repetition, from 0.
    seed : int
        Seed of the episodes and of everything random in the method.

    """

    scenario: str
    method: str
    episodes: int
    number: int
    seed: int


class Outcome(NamedTuple):
    """The result of a trial: indices of the features from 0, best first, and computing time.

    With an automatic number, these are the selected features. A study may store other numbers.
    """

    trial: Trial
    ranking: tuple[int, ...]
    seconds: float

    def rank(self, feature: int) -> int:
        """Return the rank of a feature, from 1."""
        return self.ranking.index(feature) + 1

    @property
    def rank_sum(self) -> float:
        """Sum of the ranks of the relevant features, the ordinate of the paper's Figure 6."""
        return rank_sum(self.ranking, TASKS[self.trial.scenario].relevant, len(self.ranking))


class Results:
    """The outcomes of a study, sorted, so that the order of completion does not matter."""

    def __init__(self, outcomes: Iterable[Outcome]):
        self._outcomes = sorted(outcomes)
        #: The existing methods.
        self.methods = {outcome.trial.method for outcome in self._outcomes}

    def episodes(self, scenario: str) -> list[int]:
        """Return the numbers of episodes of the trials."""
        return sorted({o.trial.episodes for o in self._outcomes if o.trial.scenario == scenario})

    def of(self, scenario: str, method: str, episodes: int) -> list[Outcome]:
        """Return the trials of one method on a task with a number of episodes."""
        return [o for o in self._outcomes if o.trial[:3] == (scenario, method, episodes)]

    def rank_sum(self, scenario: str, method: str, episodes: int) -> tuple[float, float]:
        """Return mean and standard error of the rank sum."""
        return mean_and_error([o.rank_sum for o in self.of(scenario, method, episodes)])


def run_trial(trial: Trial) -> Outcome:
    """Rank the features once; the same trial gives the same ranking on any machine."""
    task = TASKS[trial.scenario]
    episodes = task.rollout(trial.episodes, trial.seed)
    start = time.perf_counter()
    with warnings.catch_warnings():
        # Studies check themselves what the data cannot show.
        warnings.simplefilter('ignore', UserWarning)
        ranking = rank(
            trial.method, episodes, target=task.target, seed=trial.seed, sensors=task.sensors
        ).channels
    return Outcome(trial, ranking, time.perf_counter() - start)
