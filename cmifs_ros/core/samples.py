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
    """Observations, one row for a step of an episode.

    Attributes
    ----------
    returns : numpy.ndarray, shape (N,)
    states : numpy.ndarray, shape (N, v)
    owner, step : numpy.ndarray of int, shape (N,)
        Episode and time step of each row; the rows of an episode are consecutive and in order.
    rewards : numpy.ndarray, shape (N,), optional
        The reward of each step; by default 0.
    actions : numpy.ndarray, shape (N, a), optional
        The actions taken; by default none.
    sources : numpy.ndarray of str, shape (M,), optional
        The robot or recording of each episode; by default one for all.
    lengths : numpy.ndarray of int, shape (M,), optional
        The number of steps of each episode; by default its last row is its last step.
    next_states : numpy.ndarray, shape (N, v), optional
        The state after each but the last step of an episode; by default that of the next row.

    """

    returns: np.ndarray
    states: np.ndarray
    owner: np.ndarray
    step: np.ndarray
    rewards: np.ndarray = field(default=None)
    actions: np.ndarray = field(default=None)
    sources: np.ndarray = field(default=None)
    lengths: np.ndarray = field(default=None)
    next_states: np.ndarray | None = None

    def __post_init__(self):
        if self.rewards is None:
            object.__setattr__(self, 'rewards', np.zeros(len(self.returns)))
        if self.actions is None:
            object.__setattr__(self, 'actions', np.empty((len(self.returns), 0)))
        if self.sources is None:
            object.__setattr__(self, 'sources', np.full(self.owner[-1] + 1, ''))
        if self.lengths is None:
            lengths = np.zeros(len(self.sources), dtype=int)
            np.maximum.at(lengths, self.owner, self.step + 1)
            object.__setattr__(self, 'lengths', lengths)

    def with_channels(self, columns: np.ndarray) -> Samples:
        """Return the samples with further channels (N, k) appended."""
        return replace(self, states=np.hstack([self.states, columns]))

    def with_previous_actions(self) -> Samples:
        """Return the samples with the previous action as further channels.

        Rows without the row of their previous step are left out. At a first step, the channels have
        their mean.
        """
        after = 1 + np.flatnonzero((np.diff(self.owner) == 0) & (np.diff(self.step) == 1))
        previous = np.tile(self.actions.mean(axis=0), (len(self.actions), 1))
        previous[after] = self.actions[after - 1]
        rows = np.union1d(after, np.flatnonzero(self.step == 0))
        return Samples(
            self.returns[rows],
            np.hstack([self.states, previous])[rows],
            self.owner[rows],
            self.step[rows],
            self.rewards[rows],
            self.actions[rows],
            self.sources,
            self.lengths,
        )

    def without_actions(self) -> Samples:
        """Return the samples without the actions."""
        return replace(self, actions=self.actions[:, :0])

    def transitions(self) -> tuple[Samples, np.ndarray]:
        """Return the samples that have a next step, and the states (N', v) of that step."""
        rows = np.flatnonzero(self.step < self.lengths[self.owner] - 1)
        after = self.states[rows + 1] if self.next_states is None else self.next_states[rows]
        before = Samples(
            self.returns[rows],
            self.states[rows],
            self.owner[rows],
            self.step[rows],
            self.rewards[rows],
            self.actions[rows],
            self.sources,
            self.lengths - 1,
        )
        return before, after


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


def returns_of(episodes: Sequence[Episode], gamma: float) -> list[np.ndarray]:
    """Return the return of each step of each episode.

    Raises
    ------
    ValueError
        If gamma is invalid, or the rewards are so large that a return overflows.

    """
    returns = [discounted_returns(episode.rewards, gamma) for episode in episodes]
    if not all(np.isfinite(of_episode).all() for of_episode in returns):
        largest = max(np.abs(episode.rewards).max() for episode in episodes)
        raise ValueError(f'a reward is {largest:g} in size; expected returns that do not overflow')
    return returns


def samples_of(
    episodes: Sequence[Episode],
    returns: Sequence[np.ndarray],
    kept: Sequence[np.ndarray],
    *,
    with_next: bool = False,
) -> Samples:
    """Return the steps of episodes that are kept, as they are.

    Parameters
    ----------
    episodes : sequence of Episode
    returns : sequence of numpy.ndarray
        The return of each step.
    kept : sequence of numpy.ndarray of int
        The steps of each episode that become rows.
    with_next : bool
        Whether the state after each is stored, too.

    """

    def rows(arrays, kept=kept):
        return np.concatenate([array[steps] for array, steps in zip(arrays, kept, strict=True)])

    lengths = np.array([len(episode) for episode in episodes])
    next_states = None
    if with_next:
        after = [np.minimum(k + 1, length - 1) for k, length in zip(kept, lengths, strict=True)]
        next_states = rows((episode.states for episode in episodes), after)

    return Samples(
        rows(returns),
        rows(episode.states for episode in episodes),
        np.repeat(np.arange(len(episodes)), [len(steps) for steps in kept]),
        np.concatenate(kept),
        rows(episode.rewards for episode in episodes),
        rows(episode.actions for episode in episodes),
        np.array([episode.source for episode in episodes]),
        lengths,
        next_states,
    )


def scaled(samples: Samples) -> Samples:
    """Return samples with mean 0 and standard deviation 1, and normal scores but for returns.

    A constant channel becomes 0.
    """
    further = [] if samples.next_states is None else [samples.next_states]
    states = standardized(normal_scores(np.vstack([samples.states, *further])))
    return replace(
        samples,
        returns=standardized(samples.returns),
        states=states[: len(samples.states)],
        actions=standardized(normal_scores(samples.actions)),
        next_states=states[len(samples.states) :] if further else None,
    )


def collect_samples(episodes: Sequence[Episode], *, gamma: float, standardize: bool) -> Samples:
    """Return `samples_of` all steps of the episodes, `scaled` if asked."""
    kept = [np.arange(len(episode)) for episode in episodes]
    samples = samples_of(episodes, returns_of(episodes, gamma), kept)
    return scaled(samples) if standardize else samples


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
