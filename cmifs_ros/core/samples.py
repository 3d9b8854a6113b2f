"""From episodes to the samples of each time step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .episode import Episode
from .returns import discounted_returns


@dataclass(frozen=True)
class StepSamples:
    """Everything observed at one time step, or in one bin of neighbouring steps.

    Attributes
    ----------
    returns : numpy.ndarray, shape (M,)
    states : numpy.ndarray, shape (M, v)
    folds : numpy.ndarray of int, shape (M,)
        Cross-validation fold; the samples of one episode share it.
    centers : numpy.ndarray of int
        Indices of the samples that carry a kernel.

    """

    returns: np.ndarray
    states: np.ndarray
    folds: np.ndarray
    centers: np.ndarray


def step_samples(
    episodes: Sequence[Episode],
    *,
    gamma: float,
    standardize: bool,
    max_time_bins: int | None,
    num_folds: int,
    num_centers: int | None,
    random_state: int,
) -> list[StepSamples]:
    """Sort the samples of all episodes by time step.

    Episodes may differ in length: a step holds the episodes that reach it. When the longest
    episode has more steps than `max_time_bins`, neighbouring steps are pooled into that many
    bins of equal width. Folds are drawn over episodes and balanced within each step.

    Parameters
    ----------
    episodes : sequence of Episode
    gamma : float
        Discount factor of the return.
    standardize : bool
        Scale each channel and the return to mean 0 and standard deviation 1 over all samples.
        A constant channel becomes 0.
    max_time_bins : int, optional
        Greatest number of bins; None keeps every step by itself.
    num_folds : int
        Folds; fewer where fewer episodes reach a step.
    num_centers : int, optional
        Greatest number of kernel centres in a step, drawn at random; None takes all samples.
    random_state : int
        Seed of the folds and the centres.

    Raises
    ------
    ValueError
        If the rewards are so large that a return overflows.

    """
    rng = np.random.default_rng(random_state)
    priority = rng.permutation(len(episodes))

    lengths = [len(episode) for episode in episodes]
    returns = np.concatenate([discounted_returns(e.rewards, gamma) for e in episodes])
    if not np.isfinite(returns).all():
        largest = max(np.abs(episode.rewards).max() for episode in episodes)
        raise ValueError(f'a reward is {largest:g} in size; expected returns that do not overflow')
    states = np.concatenate([episode.states for episode in episodes])
    owner = np.repeat(np.arange(len(episodes)), lengths)
    step = np.concatenate([np.arange(length) for length in lengths])
    if standardize:
        returns, states = _standardized(returns), _standardized(states)

    num_bins = min(max(lengths), max_time_bins or max(lengths))
    bins = step * num_bins // max(lengths)
    samples = []
    for b in range(num_bins):
        here = np.flatnonzero(bins == b)
        present = np.unique(owner[here])
        rank = np.empty(len(episodes), dtype=int)
        rank[present[np.argsort(priority[present])]] = np.arange(len(present))
        folds = rank[owner[here]] * min(num_folds, len(present)) // len(present)
        centers = np.arange(len(here))
        if num_centers is not None and len(here) > num_centers:
            centers = np.sort(rng.choice(len(here), num_centers, replace=False))
        samples.append(StepSamples(returns[here], states[here], folds, centers))
    return samples


def _standardized(values: np.ndarray) -> np.ndarray:
    size = np.max(np.abs(values), axis=0)
    values = values / np.where(size > 0, size, 1.0)  # so that no square overflows
    constant = np.ptp(values, axis=0) == 0  # of which rounding would leave a spread of 1e-16
    centred = np.where(constant, 0.0, values - np.mean(values, axis=0))
    return centred / np.where(constant, 1.0, np.std(values, axis=0))
