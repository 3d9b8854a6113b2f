# SPDX-License-Identifier: Apache-2.0

"""Rank sensors by evidence and score, and say of each whether it is confirmed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from .effect import Effect
from .samples import Samples
from .search import Criterion, Sensor, backward_elimination
from .shadows import null_scores
from .statuses import DISPENSABLE
from .stepwise import Finding, StepwiseSelection
from .targets import TargetTest
from .time_bins import choose_time_bins
from .verdicts import Verdict, verdicts

#: Numbers of time bins are compared by this many channels, those with the smallest p-values.
_MAX_COMPARED = 10


class EvidenceRanking(NamedTuple):
    """Ranked sensors, those with evidence first.

    Attributes
    ----------
    findings : list of Finding
    verdicts : list of Verdict
    null_scores : numpy.ndarray, shape (len(findings), 3)
        As of `shadows.null_scores`.
    num_selected : int

    """

    findings: list[Finding]
    verdicts: list[Verdict]
    null_scores: np.ndarray
    num_selected: int

    @classmethod
    def of_nothing(cls) -> EvidenceRanking:
        """Return a ranking of no sensors."""
        return cls([], [], np.empty((0, 3)), 0)

    def renumbered(self, numbers: Sequence[int]) -> EvidenceRanking:
        """Return the ranking with sensor i called `numbers[i]`."""

        def of(sensors):
            return tuple(numbers[i] for i in sensors)

        return self._replace(
            findings=[
                f._replace(sensor=numbers[f.sensor], redundant_with=of(f.redundant_with))
                for f in self.findings
            ],
            verdicts=[v._replace(together_with=of(v.together_with)) for v in self.verdicts],
        )

    def followed_by_constant(self, statuses: Mapping[int, str]) -> EvidenceRanking:
        """Return the ranking with constant sensors, which add nothing, at its end.

        Parameters
        ----------
        statuses : mapping of int to str
            Their statuses, by their numbers.

        """
        score = self.findings[self.num_selected - 1].score if self.num_selected else 0.0
        return self._replace(
            findings=self.findings + [Finding(i, (), score) for i in statuses],
            verdicts=self.verdicts + [Verdict(s, Effect(0.0, 0.0), '') for s in statuses.values()],
            null_scores=np.vstack([self.null_scores, np.full((len(statuses), 3), score)]),
        )


def rank_by_evidence(
    samples: Samples,
    test: TargetTest,
    make_criterion: Callable[[Samples, int | None], Criterion],
    sensors: Sequence[Sensor],
    *,
    start: Sequence[int],
    num_features: int | None,
    direction: str,
    max_time_bins: int | str | None,
    significance: float,
    margin: float,
    rng_seed: Sequence[int],
    progress: Callable[[float], None],
) -> EvidenceRanking:
    """Rank the sensors, of which at least one.

    Parameters
    ----------
    samples : Samples
    test : TargetTest
    make_criterion : callable
        Returns the criterion for samples and a number of time bins.
    sensors : sequence of tuple of int
        Their channels, none of which is constant.
    start : sequence of int
        Sensors confirmed before: they stay, unless they are dispensable now.
    num_features, direction, max_time_bins, significance, margin
        As of `ConditionalMISelector`.
    rng_seed : sequence of int
        Seed of the shadows.
    progress : callable
        As of `StepwiseSelection`.

    """
    units = [(channel,) for sensor in sensors for channel in sensor]
    num_bins: int | None
    if isinstance(max_time_bins, str):
        likely = np.argsort(test(units, []), kind='stable')[:_MAX_COMPARED]
        make_for_bins = partial(make_criterion, samples)
        num_bins, criterion = choose_time_bins(make_for_bins, [units[i] for i in likely])
    else:
        num_bins, criterion = max_time_bins, make_criterion(samples, max_time_bins)
    search = StepwiseSelection(
        criterion, test, sensors, significance=significance, progress=progress
    )
    while True:
        if direction == 'forward':
            confirmed = search.confirmed(start)
        else:
            ranking, scores = backward_elimination(criterion, sensors)
            confirmed = search.tested(ranking[: int(np.argmax(scores)) + 1])
        confirmed = confirmed[:num_features]
        wanted = None if num_features is None else num_features - len(confirmed)
        others = [] if wanted == 0 else search.listed(confirmed)[:wanted]
        findings = [*confirmed, *others]
        found = verdicts(
            test,
            sensors,
            findings,
            len(confirmed),
            num_episodes=int(samples.owner[-1]) + 1,
            confirmed_before=start,
            significance=significance,
            margin=margin,
        )
        dispensable = {
            finding.sensor
            for finding, verdict in zip(confirmed, found, strict=False)
            if verdict.status == DISPENSABLE
        }
        if dispensable.isdisjoint(start):
            break
        start = [sensor for sensor in start if sensor not in dispensable]
    # Others than the confirmed are scored together with all of these.
    before = [findings[: min(i, len(confirmed))] for i in range(len(findings))]
    null = null_scores(
        lambda extended: make_criterion(extended, num_bins),
        samples,
        [channel for unit in units for channel in unit],
        [[c for f in rest for c in f.channels] for rest in before],
        np.random.default_rng(rng_seed),
    )
    num_selected = len(confirmed) if num_features is None else num_features
    return EvidenceRanking(findings, found, null, num_selected)
