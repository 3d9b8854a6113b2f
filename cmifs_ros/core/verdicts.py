# SPDX-License-Identifier: Apache-2.0

"""Verdicts: what each sensor adds, and whether it is confirmed, dispensable or undecided."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from .effect import Effect
from .search import Sensor
from .statuses import CONFIRMED, DISPENSABLE, FEWEST_EPISODES, UNDECIDED, USUAL_LEVEL
from .stepwise import Finding
from .targets import TargetTest


class Verdict(NamedTuple):
    """The verdict on a sensor.

    Attributes
    ----------
    status : str
        One of `STATUSES`.
    effect : Effect
        What it adds to the prediction by the other confirmed sensors.
    why : str
        The variable of the target for which the evidence is strongest.
    together_with : tuple of int
        Of an undecided sensor: the other unconfirmed sensors with which its products may add the
        margin or more, although it adds less alone.

    """

    status: str
    effect: Effect
    why: str
    together_with: tuple[int, ...] = ()


def verdicts(
    test: TargetTest,
    sensors: Sequence[Sensor],
    findings: Sequence[Finding],
    num_confirmed: int,
    *,
    num_episodes: int,
    confirmed_before: Collection[int],
    significance: float,
    margin: float,
) -> list[Verdict]:
    """Return a verdict on each finding; the first `num_confirmed` have evidence.

    Sensors confirmed before stay confirmed unless they are dispensable now. A sensor is dispensable
    if there is no evidence for it, not even at the usual level, and, with 95 % confidence, it adds
    less than `margin` of the target's variance, and so do its products with other unconfirmed
    sensors: two may matter only together. With fewer than `FEWEST_EPISODES` episodes none is
    dispensable.
    """
    confirmed = list(findings[:num_confirmed])
    given = [c for finding in confirmed for c in finding.channels]
    found = []
    for finding in confirmed:
        others = [c for other in confirmed if other is not finding for c in other.channels]
        (effect,) = test.effects([sensors[finding.sensor]], others)
        found.append((finding, effect, others))
    rest = findings[num_confirmed:]
    effects = test.effects([sensors[f.sensor] for f in rest], given) if rest else []
    found += [(f, effect, given) for f, effect in zip(rest, effects, strict=True)]
    unconfirmed = {f.sensor: effect for f, effect, _ in found if f.pvalue > significance}
    without_evidence = {f.sensor for f in findings if f.pvalue > max(significance, USUAL_LEVEL)}
    small = {s for s, e in unconfirmed.items() if e.upper_bound < margin} & without_evidence
    small = small if num_episodes >= FEWEST_EPISODES else set()
    partners = _partners(test, sensors, list(unconfirmed), given, margin) if small else {}
    dispensable = small - partners.keys()
    kept = {f.sensor for f in confirmed} & set(confirmed_before)

    def status(finding):
        if finding.sensor in dispensable:
            return DISPENSABLE
        is_confirmed = finding.pvalue <= significance or finding.sensor in kept
        return CONFIRMED if is_confirmed else UNDECIDED

    def together_with(finding):
        return tuple(sorted(partners.get(finding.sensor, ()))) if finding.sensor in small else ()

    return [
        Verdict(status(f), effect, test.why(f.channels, others), together_with(f))
        for f, effect, others in found
    ]


def _partners(test, sensors, candidates, given, margin) -> dict[int, set[int]]:
    """Return the sensors that may add `margin` or more as a pair, with those they do it with."""
    channels = [(sensor, c) for sensor in candidates for c in sensors[sensor]]
    if len(candidates) < 2:
        return {}
    bounds = test.pair_bounds([c for _, c in channels], given)
    owner = np.array([sensor for sensor, _ in channels])
    pairs = np.argwhere((bounds >= margin) & (owner[:, None] != owner))
    partners: dict[int, set[int]] = {}
    for pair in pairs:
        one, other = owner[pair].tolist()
        partners.setdefault(one, set()).add(other)
        partners.setdefault(other, set()).add(one)
    return partners
