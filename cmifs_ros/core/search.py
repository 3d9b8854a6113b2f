# SPDX-License-Identifier: Apache-2.0

"""Greedy search over subsets of sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

DIRECTIONS = ('forward', 'backward')

#: A sensor, as its channels.
Sensor = tuple[int, ...]
Criterion = Callable[[Sequence[Sequence[int]]], np.ndarray]


def forward_selection(
    criterion: Criterion, sensors: Sequence[Sensor], num_sensors: int
) -> tuple[list[int], list[float]]:
    """Repeatedly add the sensor that scores best together with those already chosen.

    This is Algorithm 1 (Figure 4) of Hachiya & Sugiyama (2010). Ties go to the first sensor.

    Parameters
    ----------
    criterion : callable
        Returns one score for each of a list of channel subsets; greater is better.
    sensors : sequence of tuple of int
        The channels of each sensor.
    num_sensors : int
        Number of sensors to add.

    Returns
    -------
    ranking : list of int
        Indices of the sensors added, best first.
    scores : list of float
        The criterion after each addition.

    """
    ranking: list[int] = []
    scores: list[float] = []
    remaining = list(range(len(sensors)))
    while len(ranking) < num_sensors:
        values = criterion([channels(sensors, [*ranking, i]) for i in remaining])
        best = int(np.argmax(values))
        scores.append(float(values[best]))
        ranking.append(remaining.pop(best))
    return ranking, scores


def backward_elimination(
    criterion: Criterion, sensors: Sequence[Sensor]
) -> tuple[list[int], list[float]]:
    """Repeatedly remove the sensor whose removal leaves the best score.

    Section 3.3 of Hachiya & Sugiyama (2010) mentions this strategy. Parameters and results are as
    in `forward_selection`: the sensor removed last is ranked first. All sensors are ranked, because
    a sensor must be removed to get its rank.
    """
    remaining = list(range(len(sensors)))
    removed: list[int] = []
    scores = [float(criterion([channels(sensors, remaining)])[0])]
    while len(remaining) > 1:
        without = [[i for i in remaining if i != j] for j in remaining]
        values = criterion([channels(sensors, rest) for rest in without])
        best = int(np.argmax(values))
        scores.append(float(values[best]))
        removed.append(remaining.pop(best))
    return [*remaining, *reversed(removed)], scores[::-1]


def channels(sensors: Sequence[Sensor], chosen: Sequence[int]) -> list[int]:
    """Return the channels of the chosen sensors, in the order of `chosen`."""
    return [channel for i in chosen for channel in sensors[i]]
