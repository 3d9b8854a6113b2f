"""Stepwise selection: the score proposes a sensor, the evidence disposes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from .evidence import ConditionalTest, Evidence
from .search import Criterion, Sensor

#: Of those with the best scores, so many are tested before a round ends without finding any.
_MAX_TESTS = 30
#: Channels of which all pairs are tried where no single one has evidence.
_MAX_PAIRED = 24
#: A sensor of so many channels may enter whole; of a larger one, one channel speaks.
_MAX_WHOLE = 3


class Proposal(NamedTuple):
    """A sensor, the channels that speak for it, and the criterion with them."""

    sensor: int
    channels: Sensor
    score: float


class Finding(NamedTuple):
    """A sensor of the result, with the channels that spoke for it and its evidence.

    The p-value of the evidence is corrected for the number of candidates (Bonferroni).
    """

    sensor: int
    channels: Sensor
    evidence: Evidence


class StepwiseSelection:
    """Find the sensors that tell something about the return given the others selected.

    Parameters
    ----------
    criterion : callable
        Scores channel subsets.
    test : ConditionalTest
    sensors : sequence of tuple of int
        The channels of each sensor, without those that never change; may be empty.
    significance : float
        Level at which a sensor is confirmed, over all sensors.
    background : sequence of int
        Channels that every score is to be given.
    progress : callable
        Told a fraction that grows with each sensor found.

    """

    def __init__(
        self,
        criterion: Criterion,
        test: ConditionalTest,
        sensors: Sequence[Sensor],
        *,
        significance: float,
        background: Sequence[int] = (),
        progress: Callable[[float], None] = lambda fraction: None,
    ):
        self._criterion = criterion
        self._test = test
        self._sensors = sensors
        self._significance = significance
        self._background = list(background)
        self._progress = progress
        self._num_units = sum(len(self._units(i)) for i in range(len(sensors)))

    def confirmed(self) -> list[Finding]:
        """Return the confirmed sensors, in the order in which they were found."""
        chosen: list[Proposal] = []
        while len(chosen) < len(self._sensors):
            found = self._next(chosen)
            if not found and not chosen:
                found = self._pair()
            if not found:
                break
            chosen += found
            self._progress(1 - 0.5 ** len(chosen))
        return self._without_superfluous(chosen)

    def tested(self, sensors: Sequence[int]) -> list[Finding]:
        """Return those of the sensors, each whole, that have evidence given the others."""
        return self._without_superfluous([Proposal(i, self._sensors[i], 0.0) for i in sensors])

    def ranked(self, chosen: Sequence[Finding], count: int) -> list[Finding]:
        """Return at most `count` of the other sensors by score, with their evidence so far."""
        taken, rest = [(f.sensor, f.channels) for f in chosen], []
        while len(rest) < count:
            proposals = self._proposals(taken)
            if not proposals:
                break
            best = proposals[0]
            given = self._given(taken)
            rest.append(self._finding(best, self._test(best.channels, given)))
            taken.append((best.sensor, best.channels))
        return rest

    def listed(self, chosen: Sequence[Finding]) -> list[Finding]:
        """Return all other sensors by their scores with the chosen ones, each tested.

        Those that a test rejects come last: a copy costs less than a sensor that tells a little.
        """
        taken = [(f.sensor, f.channels) for f in chosen]
        given = self._given(taken)
        found = [self._finding(p, self._test(p.channels, given)) for p in self._proposals(taken)]
        return sorted(found, key=lambda f: f.evidence.pvalue >= 1)

    def _units(self, sensor: int) -> list[Sensor]:
        channels = self._sensors[sensor]
        single = [(channel,) for channel in channels]
        return [*single, channels] if 1 < len(channels) <= _MAX_WHOLE else single

    def _given(self, taken) -> list[int]:
        return [*self._background, *(channel for _, channels in taken for channel in channels)]

    def _proposals(self, taken) -> list[Proposal]:
        """Return the best unit of each sensor that is left, best score first."""
        given, used = self._given(taken), {sensor for sensor, _ in taken}
        left = [i for i in range(len(self._sensors)) if i not in used]
        units = [(i, unit) for i in left for unit in self._units(i)]
        if not units:
            return []
        scores = self._criterion([[*given, *unit] for _, unit in units])
        best: dict[int, Proposal] = {}
        for (i, unit), score in zip(units, scores, strict=True):
            if i not in best or score > best[i].score:
                best[i] = Proposal(i, unit, float(score))
        return sorted(best.values(), key=lambda p: -p.score)

    def _next(self, chosen: list[Proposal]) -> list[Proposal]:
        """Return the best-scored sensor that has evidence given those chosen, or none."""
        taken = [(p.sensor, p.channels) for p in chosen]
        given = self._given(taken)
        for proposal in self._proposals(taken)[:_MAX_TESTS]:
            if self._is_evident(self._test(proposal.channels, given)):
                return [proposal]
        return []

    def _pair(self) -> list[Proposal]:
        """Return the best of all pairs, if each of the two has evidence given the other."""
        singles = self._proposals([])[:_MAX_PAIRED]
        pairs = list(combinations(singles, 2))
        if not pairs:
            return []
        scores = self._criterion([[*self._background, *a.channels, *b.channels] for a, b in pairs])
        best = pairs[int(np.argmax(scores))]
        for one, other in (best, best[::-1]):
            evidence = self._test(one.channels, [*self._background, *other.channels])
            if evidence.pvalue * len(pairs) > self._significance:
                return []
        return list(best)

    def _without_superfluous(self, chosen: list[Proposal]) -> list[Finding]:
        """Remove what has no evidence given the rest, the weakest first."""
        while chosen:
            findings = []
            for proposal in chosen:
                rest = [(p.sensor, p.channels) for p in chosen if p is not proposal]
                evidence = self._test(proposal.channels, self._given(rest), in_full=True)
                findings.append(self._finding(proposal, evidence))
            weakest = max(range(len(chosen)), key=lambda i: findings[i].evidence.pvalue)
            if findings[weakest].evidence.pvalue <= self._significance:
                return findings
            chosen = [p for i, p in enumerate(chosen) if i != weakest]
        return []

    def _is_evident(self, evidence: Evidence) -> bool:
        return evidence.pvalue * self._num_units <= self._significance

    def _finding(self, proposal: Proposal, evidence: Evidence) -> Finding:
        corrected = min(1.0, evidence.pvalue * self._num_units)
        return Finding(proposal.sensor, proposal.channels, evidence._replace(pvalue=corrected))
