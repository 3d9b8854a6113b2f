"""Greedy search over subsets of sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

DIRECTIONS = ('forward', 'backward')

#: A sensor is the channels it delivers.
Sensor = tuple[int, ...]
Criterion = Callable[[Sequence[Sequence[int]]], np.ndarray]


def forward_selection(
    criterion: Criterion, sensors: Sequence[Sensor], num_sensors: int
) -> tuple[list[int], list[float]]:
    """Add the sensor that, with those already chosen, scores best; repeat.

    Algorithm 1 (Figure 4) of Hachiya & Sugiyama (2010). Of equal scores the first wins.

    Parameters
    ----------
    criterion : callable
        Gives one score for each of a list of channel subsets; greater is better.
    sensors : sequence of tuple of int
        The channels of each sensor.
    num_sensors : int
        How many to add.

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
    """Remove the sensor whose removal leaves the best score; repeat until none is left.

    Section 3.3 of Hachiya & Sugiyama (2010) names this strategy. Parameters and results are
    those of `forward_selection`: the sensor removed last is ranked first. Every sensor has to
    be removed to be ranked, so all of them are.
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
    """Return the channels of the chosen sensors, in their order."""
    return [channel for i in chosen for channel in sensors[i]]
