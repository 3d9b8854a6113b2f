"""Stepwise selection: the score proposes a sensor, the evidence disposes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from .evidence import ConditionalTest
from .search import Criterion, Sensor

#: Of those with the best scores, so many are tested before a round ends without finding any.
_MAX_TESTS = 30
#: Channels of which all pairs are tried where no single one has evidence.
_MAX_PAIRED = 24
#: p-value, for no choice corrected, from which on nothing speaks for a sensor.
_LEAST_LIKELY = 0.2
#: A sensor of so many channels may enter whole; of a larger one, one channel speaks.
_MAX_WHOLE = 3


class Finding(NamedTuple):
    """A sensor, the channels that speak for it, the criterion with them, and its evidence.

    The p-value is corrected for the number of candidates that were left (Holm).
    """

    sensor: int
    channels: Sensor
    score: float
    pvalue: float = 1.0


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

    def confirmed(self, start: Sequence[int] = ()) -> list[Finding]:
        """Return the confirmed sensors, in the order in which they were found.

        The search begins with those of `start` that have evidence given each other.
        """
        known = [f._replace(pvalue=0.0) for f in self._proposals([]) if f.sensor in start]
        chosen = self._without_superfluous(known, num_candidates=self._num_units)
        while len(chosen) < len(self._sensors):
            found = self._next(chosen)
            if not found and not chosen:
                found = self._pair()
            if not found:
                break
            chosen += found
            self._progress(1 - 0.5 ** len(chosen))
        return self._scored(self._without_superfluous(chosen))

    def tested(self, sensors: Sequence[int]) -> list[Finding]:
        """Return those of the sensors, each whole, that have evidence given the others."""
        chosen = [Finding(i, self._sensors[i], 0.0, pvalue=0.0) for i in sensors]
        return self._scored(self._without_superfluous(chosen, num_candidates=self._num_units))

    def ranked(self, chosen: Sequence[Finding], count: int) -> list[Finding]:
        """Return at most `count` of the other sensors, each tested given those before."""
        taken = list(chosen)
        while len(taken) < len(chosen) + count and (proposals := self._proposals(taken)):
            taken.append(self._tested(self._likely(proposals, taken) or proposals[0], taken))
        return taken[len(chosen) :]

    def listed(self, chosen: Sequence[Finding]) -> list[Finding]:
        """Return all other sensors, each scored and tested with the chosen ones.

        First come those that forward selection would add while one of them is likely to tell
        something or the score rises, then the others by their scores beside all of these.
        """
        proposals = self._proposals(chosen)
        added, score = list(chosen), chosen[-1].score if chosen else 0.0
        while rest := self._proposals(added):
            best = self._likely(rest, added)
            if best is None and rest[0].score <= score:
                break
            best = best or rest[0]
            score = best.score
            added.append(best)
        place = {finding.sensor: i for i, finding in enumerate([*added, *rest])}
        found = [self._tested(proposal, chosen) for proposal in proposals]
        return sorted(found, key=lambda finding: place[finding.sensor])

    def _likely(self, proposals: Sequence[Finding], taken: Sequence[Finding]) -> Finding | None:
        """Return the best scored that is likely to tell something beside those taken, if any."""
        given = self._given(taken)
        likely = (f for f in proposals if self._test(f.channels, given) <= _LEAST_LIKELY)
        return next(likely, None)

    def _units(self, sensor: int) -> list[Sensor]:
        channels = self._sensors[sensor]
        single = [(channel,) for channel in channels]
        return [*single, channels] if 1 < len(channels) <= _MAX_WHOLE else single

    def _given(self, taken: Sequence[Finding]) -> list[int]:
        return [*self._background, *(channel for f in taken for channel in f.channels)]

    def _proposals(self, taken: Sequence[Finding]) -> list[Finding]:
        """Return the best unit of each sensor that is left, best score first."""
        given, used = self._given(taken), {finding.sensor for finding in taken}
        left = [i for i in range(len(self._sensors)) if i not in used]
        units = [(i, unit) for i in left for unit in self._units(i)]
        if not units:
            return []
        scores = self._criterion([[*given, *unit] for _, unit in units])
        best: dict[int, Finding] = {}
        for (i, unit), score in zip(units, scores, strict=True):
            if i not in best or score > best[i].score:
                best[i] = Finding(i, unit, float(score))
        return sorted(best.values(), key=lambda f: -f.score)

    def _next(self, chosen: list[Finding]) -> list[Finding]:
        """Return the best-scored sensor that has evidence given those chosen, or none."""
        for proposal in self._proposals(chosen)[:_MAX_TESTS]:
            found = self._tested(proposal, chosen)
            if found.pvalue <= self._significance:
                return [found]
        return []

    def _pair(self) -> list[Finding]:
        """Return the best of all pairs, if each of the two has evidence given the other."""
        singles = self._proposals([])[:_MAX_PAIRED]
        pairs = list(combinations(singles, 2))
        if not pairs:
            return []
        scores = self._criterion([[*self._background, *a.channels, *b.channels] for a, b in pairs])
        best = pairs[int(np.argmax(scores))]
        found = [self._tested(one, [other], len(pairs)) for one, other in (best, best[::-1])]
        return found if max(f.pvalue for f in found) <= self._significance else []

    def _without_superfluous(self, chosen: list[Finding], num_candidates: int = 1) -> list[Finding]:
        """Remove what has no evidence given the rest, the weakest first.

        What was found among many candidates is not one of many any more: its p-value is that of
        then, unless the greater one is that given the rest.
        """
        given_rest: list[float] = []
        while chosen:
            given_rest = [
                self._tested(f, [g for g in chosen if g is not f], num_candidates).pvalue
                for f in chosen
            ]
            weakest = int(np.argmax(given_rest))
            if given_rest[weakest] <= self._significance:
                break
            chosen = [finding for i, finding in enumerate(chosen) if i != weakest]
        return [
            finding._replace(pvalue=max(pvalue, finding.pvalue))
            for finding, pvalue in zip(chosen, given_rest[: len(chosen)], strict=True)
        ]

    def _tested(
        self, finding: Finding, taken: Sequence[Finding], num_candidates: int | None = None
    ) -> Finding:
        """Return the finding with its p-value, corrected for the units that are left."""
        if num_candidates is None:
            num_candidates = self._num_units - sum(len(self._units(f.sensor)) for f in taken)
        pvalue = self._test(finding.channels, self._given(taken)) * num_candidates
        return finding._replace(pvalue=min(1.0, pvalue))

    def _scored(self, chosen: list[Finding]) -> list[Finding]:
        """Return the findings, each with the criterion of it and those before it."""
        return [
            finding._replace(score=float(self._criterion([self._given(chosen[: i + 1])])[0]))
            for i, finding in enumerate(chosen)
        ]
