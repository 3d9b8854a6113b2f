# SPDX-License-Identifier: Apache-2.0

"""From episodes to the samples of each time step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from .episode import Episode
from .returns import discounted_returns


@dataclass(frozen=True)
class Samples:
    """All observations, one row for each step of an episode.

    Attributes
    ----------
    returns : numpy.ndarray, shape (N,)
    states : numpy.ndarray, shape (N, v)
    owner, step : numpy.ndarray of int, shape (N,)
        Episode and time step of each row; the rows of an episode are consecutive.
    rewards : numpy.ndarray, shape (N,), optional
        The reward of each step; by default 0.
    actions : numpy.ndarray, shape (N, a), optional
        The actions taken; by default none.
    sources : numpy.ndarray of str, shape (M,), optional
        The robot or recording of each episode; by default one for all.

    """

    returns: np.ndarray
    states: np.ndarray
    owner: np.ndarray
    step: np.ndarray
    rewards: np.ndarray = field(default=None)
    actions: np.ndarray = field(default=None)
    sources: np.ndarray = field(default=None)

    def __post_init__(self):
        if self.rewards is None:
            object.__setattr__(self, 'rewards', np.zeros(len(self.returns)))
        if self.actions is None:
            object.__setattr__(self, 'actions', np.empty((len(self.returns), 0)))
        if self.sources is None:
            object.__setattr__(self, 'sources', np.full(self.owner[-1] + 1, ''))

    def with_channels(self, columns: np.ndarray) -> Samples:
        """Return the samples with further channels (N, k) appended."""
        return replace(self, states=np.hstack([self.states, columns]))

    def without_actions(self) -> Samples:
        """Return the samples without the actions."""
        return replace(self, actions=self.actions[:, :0])

    def transitions(self) -> tuple[Samples, np.ndarray]:
        """Return the samples that have a next step, and the states (N', v) of that step."""
        rows = np.flatnonzero(self.owner[1:] == self.owner[:-1])
        before = Samples(
            self.returns[rows],
            self.states[rows],
            self.owner[rows],
            self.step[rows],
            self.rewards[rows],
            self.actions[rows],
            self.sources,
        )
        return before, self.states[rows + 1]


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


def collect_samples(episodes: Sequence[Episode], *, gamma: float, standardize: bool) -> Samples:
    """Return the samples of all episodes.

    Parameters
    ----------
    episodes : sequence of Episode
    gamma : float
        Discount factor of the return.
    standardize : bool
        Scale the return and the normal scores of each channel to mean 0 and standard deviation 1
        over all samples, a constant channel to 0.

    Raises
    ------
    ValueError
        If the rewards are so large that a return overflows.

    """
    lengths = [len(episode) for episode in episodes]
    returns = np.concatenate([discounted_returns(e.rewards, gamma) for e in episodes])
    if not np.isfinite(returns).all():
        largest = max(np.abs(episode.rewards).max() for episode in episodes)
        raise ValueError(f'a reward is {largest:g} in size; expected returns that do not overflow')
    states = np.concatenate([episode.states for episode in episodes])
    actions = np.concatenate([episode.actions for episode in episodes])
    if standardize:
        returns = standardized(returns)
        states = standardized(normal_scores(states))
        actions = standardized(normal_scores(actions))
    owner = np.repeat(np.arange(len(episodes)), lengths)
    step = np.concatenate([np.arange(length) for length in lengths])
    sources = np.array([episode.source for episode in episodes])
    rewards = np.concatenate([episode.rewards for episode in episodes])
    return Samples(returns, states, owner, step, rewards, actions, sources)


def split_by_step(
    samples: Samples,
    *,
    max_time_bins: int | None,
    num_folds: int,
    num_centers: int | None,
    random_state: int,
    max_samples: int | None = None,
) -> list[StepSamples]:
    """Sort samples by time step.

    Episodes may differ in length: a step holds the episodes that reach it. When the longest
    episode has more steps than `max_time_bins`, neighbouring steps are pooled into that many
    bins of equal width. Folds are drawn over episodes and balanced within each step.

    Parameters
    ----------
    samples : Samples
    max_time_bins : int, optional
        Greatest number of bins; None never pools steps.
    num_folds : int
        Number of folds; fewer at a step that fewer episodes reach.
    num_centers : int, optional
        Greatest number of kernel centres in a step, drawn at random; None takes all samples.
    random_state : int
        Seed of the folds, the centres and the samples left out.
    max_samples : int, optional
        Greatest number of samples in a bin, drawn at random; None keeps all.

    """
    rng = np.random.default_rng(random_state)
    num_episodes, num_steps = samples.owner[-1] + 1, samples.step.max() + 1
    priority = rng.permutation(num_episodes)
    num_bins = min(num_steps, max_time_bins or num_steps)
    bins = samples.step * num_bins // num_steps
    steps = []
    for b in range(num_bins):
        here = np.flatnonzero(bins == b)
        if max_samples is not None and len(here) > max_samples:
            here = np.sort(rng.choice(here, max_samples, replace=False))
        owner = samples.owner[here]
        present = np.unique(owner)
        rank = np.empty(num_episodes, dtype=int)
        rank[present[np.argsort(priority[present])]] = np.arange(len(present))
        folds = rank[owner] * min(num_folds, len(present)) // len(present)
        centers = np.arange(len(here))
        if num_centers is not None and len(here) > num_centers:
            centers = np.sort(rng.choice(len(here), num_centers, replace=False))
        steps.append(StepSamples(samples.returns[here], samples.states[here], folds, centers))
    return steps


def step_samples(
    episodes: Sequence[Episode], *, gamma: float, standardize: bool, **options
) -> list[StepSamples]:
    """Return `collect_samples` of the episodes, `split_by_step` with the options."""
    return split_by_step(collect_samples(episodes, gamma=gamma, standardize=standardize), **options)


def normal_scores(values: np.ndarray) -> np.ndarray:
    """Return values (N,) or (N, v) as normal scores: quantiles of their ranks; ties share one.

    Mutual information is invariant under monotone maps of a variable. With normal scores, an absurd
    reading is merely the largest one, and readings over several decades are evenly spaced.
    """
    scores = np.empty(values.shape)
    for column, of_column in zip(np.atleast_2d(values.T), np.atleast_2d(scores.T), strict=True):
        _, which, counts = np.unique(column, return_inverse=True, return_counts=True)
        share = (np.cumsum(counts) - counts / 2) / len(values)
        of_column[:] = special.ndtri(share)[which]
    return scores


def standardized(values: np.ndarray) -> np.ndarray:
    """Scale values (N,) or (N, v) to mean 0 and standard deviation 1, constants to 0."""
    size = np.max(np.abs(values), axis=0)
    values = values / np.where(size > 0, size, 1.0)  # so that no square overflows
    constant = np.ptp(values, axis=0) == 0  # whose spread would be 1e-16 by rounding
    centred = np.where(constant, 0.0, values - np.mean(values, axis=0))
    return centred / np.where(constant, 1.0, np.std(values, axis=0))
