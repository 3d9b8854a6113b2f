"""One selection as a job: settings and episodes in, a plain result out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .episode import Episode
from .selector import ConditionalMISelector, KDRSelector

METHODS = {'conditional_mi': ConditionalMISelector, 'kdr': KDRSelector}


@dataclass(frozen=True)
class Selection:
    """What was selected, and on what evidence.

    Attributes
    ----------
    indices : tuple of int
        Selected channels, best sensor first.
    names : tuple of str
        Their names.
    ranking : tuple of str
        Names of all sensors that were ranked, best first.
    scores : tuple of float
        The criterion of the first 1, 2, ... sensors of the ranking.
    episodes, steps : int
        Size of the data it rests on.
    seconds : float
        Computing time.
    means, spreads : tuple of float
        Mean and standard deviation of each channel, and last of the reward, in those data.

    """

    indices: tuple[int, ...]
    names: tuple[str, ...]
    ranking: tuple[str, ...]
    scores: tuple[float, ...]
    episodes: int
    steps: int
    seconds: float
    means: tuple[float, ...] = ()
    spreads: tuple[float, ...] = ()


def select(
    episodes: Sequence[Episode], channel_names: Sequence[str], method: str, settings: dict
) -> Selection:
    """Fit the selector of a method, with the given settings, and return what it found."""
    start = time.perf_counter()
    selector = METHODS[method](**settings).fit(episodes, names=channel_names)
    samples = np.concatenate([np.column_stack([e.states, e.rewards]) for e in episodes])
    with np.errstate(over='ignore', invalid='ignore'):  # Huge values: their spread is inf.
        means, spreads = samples.mean(axis=0), samples.std(axis=0)
    return Selection(
        indices=tuple(selector.get_support(indices=True).tolist()),
        names=tuple(selector.get_feature_names_out()),
        ranking=tuple(selector.sensor_names_[i] for i in selector.ranking_),
        scores=tuple(selector.scores_.tolist()),
        episodes=len(episodes),
        steps=sum(map(len, episodes)),
        seconds=time.perf_counter() - start,
        means=tuple(means.tolist()),
        spreads=tuple(spreads.tolist()),
    )
