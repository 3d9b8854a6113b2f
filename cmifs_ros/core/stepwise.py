# SPDX-License-Identifier: Apache-2.0

"""Stepwise selection: add the sensor with the best score among those with evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from .chance import combined_pvalue
from .search import Criterion, Sensor
from .targets import TargetTest

#: Number of sensors without evidence that are listed given each other, and of the likeliest among
#: which each is looked for: all would take most of the time where there are hundreds.
_MAX_LISTED = 8
_MAX_LIKELY = 50
#: Of these, the likeliest that are compared by their scores.
_MAX_SCORED = 10
#: Number of pairs, those whose products are likeliest, that are tested given each other.
_MAX_PAIRED = 10
#: Evidence is strong if the p-value is at most this share of the level.
_STRONG = 0.1
#: Sensors with a greater uncorrected p-value are unlikely to be informative.
_LEAST_LIKELY = 0.2
#: A sensor of up to this many channels may enter whole; a larger one enters by one channel.
_MAX_WHOLE = 3


class Finding(NamedTuple):
    """A sensor with its supporting channels, its score and its evidence.

    The p-value is corrected for the number of remaining candidates (Bonferroni). `redundant_with`
    are confirmed sensors: without one of them there would be strong evidence for this one.
    """

    sensor: int
    channels: Sensor
    score: float
    pvalue: float = 1.0
    redundant_with: tuple[int, ...] = ()


class StepwiseSelection:
    """Find the sensors that are informative given the other selected ones.

    Parameters
    ----------
    criterion : callable
        Scores channel subsets.
    test : TargetTest
    sensors : sequence of tuple of int
        The channels of each sensor, without constant ones.
    significance : float
        Level at which a sensor is confirmed, over all sensors.
    progress : callable
        Called with a fraction that grows with each sensor found.

    """

    def __init__(
        self,
        criterion: Criterion,
        test: TargetTest,
        sensors: Sequence[Sensor],
        *,
        significance: float,
        progress: Callable[[float], None] = lambda fraction: None,
    ):
        self._criterion = criterion
        self._test = test
        self._sensors = sensors
        self._significance = significance
        self._progress = progress

    def confirmed(self, start: Sequence[int] = ()) -> list[Finding]:
        """Return the confirmed sensors, in the order in which they were found.

        The search begins with the sensors of `start`, which stay. Sensors with weak evidence come
        last, because a sensor that adds much and one that is redundant with it may score alike.
        """
        known = [f._replace(pvalue=0.0) for f in self._candidates(start, [])]
        chosen = self._joined([], known)
        while len(chosen) < len(self._sensors):
            found = self._next(chosen) or self._pair(chosen)
            if not found:
                break
            chosen = self._joined(chosen, found)
            self._progress(1 - 0.5 ** len(chosen))
        chosen = self._without_superfluous(chosen, kept=start)
        return self._scored(sorted(chosen, key=lambda f: f.pvalue > _STRONG * self._significance))

    def tested(self, sensors: Sequence[int]) -> list[Finding]:
        """Return those of the sensors, each as a whole, that have evidence given the others."""
        chosen = [Finding(i, self._sensors[i], 0.0, pvalue=0.0) for i in sensors]
        return self._scored(self._without_superfluous(chosen, num_candidates=len(self._sensors)))

    def listed(self, chosen: Sequence[Finding]) -> list[Finding]:
        """Return all other sensors, each scored and tested with the chosen ones.

        First come those that are likely to be informative given these and each other, then the
        rest by their scores.
        """
        added = list(chosen)
        pvalues = self._evidence(self._left(chosen), chosen)[0]
        likeliest = set(sorted(pvalues, key=pvalues.__getitem__)[:_MAX_LIKELY])
        while len(added) < len(chosen) + _MAX_LISTED:
            left = [i for i in self._left(added) if i in likeliest]
            likely = self._candidates(left, added, _LEAST_LIKELY, _MAX_SCORED)
            if not likely:
                break
            added.append(likely[0])
        place = {finding.sensor: i for i, finding in enumerate(added)}
        redundant_with = self._redundant_with(chosen)
        others = [
            finding._replace(redundant_with=redundant_with.get(finding.sensor, ()))
            for finding in self._candidates(self._left(chosen), chosen)
        ]
        return sorted(others, key=lambda finding: place.get(finding.sensor, len(place)))

    def _units(self, sensor: int) -> list[Sensor]:
        channels = self._sensors[sensor]
        single: list[Sensor] = [(channel,) for channel in channels]
        return [*single, channels] if 1 < len(channels) <= _MAX_WHOLE else single

    def _given(self, taken: Sequence[Finding]) -> list[int]:
        return [channel for f in taken for channel in f.channels]

    def _left(self, taken: Sequence[Finding]) -> list[int]:
        used = {finding.sensor for finding in taken}
        return [i for i in range(len(self._sensors)) if i not in used]

    def _num_left(self, taken: Sequence[Finding]) -> int:
        return len(self._sensors) - len(taken)

    def _candidates(
        self,
        sensors: Sequence[int],
        taken: Sequence[Finding],
        level: float = 1.0,
        most: int | None = None,
    ) -> list[Finding]:
        """Return the best unit of each sensor, best score first.

        Only for those whose uncorrected p-value is at most `level`, and for so many of the
        likeliest, because scores are expensive.
        """
        given = self._given(taken)
        of_sensor, of_units = self._evidence(sensors, taken)
        likeliest = set(sorted(of_sensor, key=of_sensor.__getitem__)[:most])
        # If the p-value of a sensor is small enough, that of one of its units is even smaller.
        units = [
            (i, u)
            for (i, u), p in of_units.items()
            if i in likeliest and max(p, of_sensor[i]) <= level
        ]
        scores = self._criterion([[*given, *unit] for _, unit in units])
        best: dict[int, Finding] = {}
        for (i, unit), score in zip(units, scores, strict=True):
            if i not in best or score > best[i].score:
                pvalue = min(1.0, of_sensor[i] * self._num_left(taken))
                best[i] = Finding(i, unit, float(score), pvalue)
        return sorted(best.values(), key=lambda f: -f.score)

    def _evidence(
        self, sensors: Sequence[int], taken: Sequence[Finding]
    ) -> tuple[dict[int, float], dict[tuple[int, Sensor], float]]:
        """Return the p-value of each sensor given those taken, and those of its units."""
        units = [(i, unit) for i in sensors for unit in self._units(i)]
        pvalues = self._test([unit for _, unit in units], self._given(taken))
        of_units = dict(zip(units, pvalues, strict=True))
        of_sensor = {i: combined_pvalue([of_units[i, u] for u in self._units(i)]) for i in sensors}
        return of_sensor, of_units

    def _next(self, chosen: list[Finding]) -> list[Finding]:
        """Return the best-scored sensor that has evidence given those chosen, or none."""
        level = self._significance / self._num_left(chosen)
        return self._candidates(self._left(chosen), chosen, level)[:1]

    def _joined(self, chosen: list[Finding], found: list[Finding]) -> list[Finding]:
        """Return both, with further channels of their sensors added to those found."""
        for place, finding in enumerate(found):
            chosen = [*chosen, self._grown(finding, [*chosen, *found[place + 1 :]])]
        return chosen

    def _grown(self, finding: Finding, others: Sequence[Finding]) -> Finding:
        """Return the finding with further channels of its sensor that have evidence."""
        while left := [c for c in self._sensors[finding.sensor] if c not in finding.channels]:
            pvalues = self._test([(c,) for c in left], self._given([*others, finding]))
            likeliest = int(np.argmin(pvalues))
            if pvalues[likeliest] * len(left) > self._significance:
                break
            finding = finding._replace(channels=(*finding.channels, left[likeliest]))
        return finding

    def _pair(self, chosen: list[Finding]) -> list[Finding]:
        """Return two sensors whose product has evidence, and each given the other, or none.

        In episodes left out they have to predict more together than either alone. (The score says
        little of products: it knows neither the action nor what is explained already.)
        """
        units = [(i, c) for i in self._left(chosen) for c in self._sensors[i]]
        sensor = np.array([i for i, _ in units])
        is_pair = np.triu(sensor[:, None] != sensor)
        num_pairs = int(is_pair.sum())
        pvalues = self._test.pair_pvalues([c for _, c in units], self._given(chosen)) * num_pairs
        likely = np.argwhere(is_pair & (pvalues <= self._significance)).tolist()
        for one, other in sorted(likely, key=lambda pair: pvalues[tuple(pair)])[:_MAX_PAIRED]:
            found = [Finding(i, (c,), 0.0) for i, c in (units[one], units[other])]
            beside = [
                float(self._test([a.channels], self._given([*chosen, b]))[0])
                for a, b in permutations(found)
            ]
            pvalue = max(float(pvalues[one, other]), num_pairs * max(beside))
            if pvalue > self._significance:
                continue
            sets = [chosen, *([*chosen, single] for single in found), [*chosen, *found]]
            *fewer, together = (self._test.predicted_share(self._given(taken)) for taken in sets)
            if together > max(fewer):
                return [single._replace(pvalue=pvalue) for single in found]
        return []

    def _without_superfluous(
        self, chosen: list[Finding], num_candidates: int = 1, kept: Sequence[int] = ()
    ) -> list[Finding]:
        """Remove sensors without evidence given the rest, the weakest first; keep those of `kept`.

        The new p-value is not corrected for the number of candidates; each finding keeps the
        greater one of its two p-values.
        """
        given_rest: list[float] = []
        while chosen:
            given_rest = [
                float(self._test([f.channels], self._given([g for g in chosen if g is not f]))[0])
                for f in chosen
            ]
            given_rest = [min(1.0, p * num_candidates) for p in given_rest]
            weak = [
                i
                for i, finding in enumerate(chosen)
                if given_rest[i] > self._significance and finding.sensor not in kept
            ]
            if not weak:
                break
            del chosen[max(weak, key=given_rest.__getitem__)]
        return [
            finding._replace(pvalue=max(pvalue, finding.pvalue))
            for finding, pvalue in zip(chosen, given_rest[: len(chosen)], strict=True)
        ]

    def _redundant_with(self, confirmed: Sequence[Finding]) -> dict[int, tuple[int, ...]]:
        """Return the confirmed sensors that other sensors are redundant with, by these."""
        replaced: dict[int, tuple[int, ...]] = {}
        for place, finding in enumerate(confirmed):
            rest = [*confirmed[:place], *confirmed[place + 1 :]]
            level = _STRONG * self._significance / self._num_left(rest)
            for sensor, pvalue in self._evidence(self._left(confirmed), rest)[0].items():
                if pvalue <= level:
                    replaced[sensor] = (*replaced.get(sensor, ()), finding.sensor)
        return replaced

    def _scored(self, chosen: list[Finding]) -> list[Finding]:
        """Return the findings, each with its score together with those before it."""
        return [
            finding._replace(score=float(self._criterion([self._given(chosen[: i + 1])])[0]))
            for i, finding in enumerate(chosen)
        ]
