# SPDX-License-Identifier: Apache-2.0

"""Thin episodes to as many steps as a selection looks at, wherever the episodes are.

Neighbouring steps carry nearly the same information, so the cost of a selection need not grow with
their number. Each episode is thinned by itself, with a plan that depends on the lengths of all of
them alone. So the parts of a large recording may be thinned where they are, on other machines, and
joined; the result is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import compress, pairwise

import numpy as np
import numpy.typing as npt

from .episode import Episode
from .fingerprints import fingerprints_of_runs
from .samples import Samples, returns_of, samples_of

#: More steps than these are thinned.
MAX_STEPS = 32_000
#: Number of steps whose fingerprints are kept to find out whether episodes overlap.
_MAX_COMPARED = 100_000


@dataclass(frozen=True)
class Plan:
    """What is kept of each of M episodes.

    Attributes
    ----------
    kept : list of numpy.ndarray of int
        The steps that are kept of each.
    is_compared : numpy.ndarray of bool, shape (M,)
        Whether the fingerprints of its steps are kept.
    with_next : bool
        Whether the state after each step is kept, because that step may not be.

    """

    kept: list[np.ndarray]
    is_compared: np.ndarray
    with_next: bool

    def split(self, counts: Sequence[int]) -> list[Plan]:
        """Return the plans of consecutive parts with so many episodes."""
        ends = np.cumsum([0, *counts]).tolist()
        return [
            Plan(self.kept[a:b], self.is_compared[a:b], self.with_next) for a, b in pairwise(ends)
        ]


def plan_of(
    lengths: npt.ArrayLike,
    seed: int = 0,
    *,
    max_steps: int | None = MAX_STEPS,
    with_next: bool = False,
) -> Plan:
    """Return the plan for episodes of given lengths.

    Of more steps than are to be kept, one is drawn from each of so many equal shares of all steps
    in their order. So each has the same chance, and long episodes are thinned evenly; of many short
    ones some have no step.

    Parameters
    ----------
    lengths : array_like of int, shape (M,)
        The number of steps of each episode, in order.
    seed : int
    max_steps : int, optional
        Greatest number of steps to keep; None keeps all.
    with_next : bool
        Whether the state after each step is needed.

    """
    lengths = np.asarray(lengths, dtype=int)
    ends = np.cumsum(lengths)
    is_compared = ends - lengths < _MAX_COMPARED
    if max_steps is None or ends[-1] <= max_steps:
        return Plan([np.arange(length) for length in lengths], is_compared, False)
    places = np.arange(max_steps) + np.random.default_rng([seed, 6]).random(max_steps)
    drawn = np.unique((places * (ends[-1] / max_steps)).astype(int))
    of_episode = np.split(drawn, np.searchsorted(drawn, ends[:-1]))
    kept = [d - first for d, first in zip(of_episode, ends - lengths, strict=True)]
    return Plan(kept, is_compared, with_next)


@dataclass(frozen=True)
class ThinnedEpisodes:
    """A bounded number of steps of M episodes, and what is known of all steps.

    Its size does not depend on the number of steps; of an episode without kept steps it holds a few
    numbers.

    Attributes
    ----------
    samples : Samples
        The steps that are kept, as they are.
    mean_returns, totals : numpy.ndarray, shape (M,)
        The mean return of each episode, and the sum of its rewards.
    extreme_rewards : numpy.ndarray, shape (M, 2)
        Its least and greatest reward.
    mean_states : numpy.ndarray, shape (K, v)
        The mean state of each episode that has kept steps, over all of its steps.
    ranges : numpy.ndarray, shape (2, v)
        The least and the greatest value of each channel.
    prints, printed : numpy.ndarray of int, shape (P,)
        Fingerprints of the steps of some episodes, and the episodes.
    places : numpy.ndarray of int, shape (M,)
        The index of each episode among those given, of which some were copies.
    num_copies : int
        Number of copies left out.

    """

    samples: Samples
    mean_returns: np.ndarray
    totals: np.ndarray
    extreme_rewards: np.ndarray
    mean_states: np.ndarray
    ranges: np.ndarray
    prints: np.ndarray
    printed: np.ndarray
    places: np.ndarray
    num_copies: int = 0

    def __len__(self) -> int:
        """Return the number of episodes M."""
        return len(self.mean_returns)

    @property
    def num_channels(self) -> int:
        """Number of channels v of the state."""
        return self.samples.states.shape[1]

    @property
    def num_steps(self) -> int:
        """Number of steps of all episodes, kept or not."""
        return int(self.samples.lengths.sum())

    def only(self, which: np.ndarray) -> ThinnedEpisodes:
        """Return some of the episodes, by their indices in increasing order."""
        rows, owner = _among(which, self.samples.owner)
        compared, printed = _among(which, self.printed)
        present = np.isin(np.unique(self.samples.owner), which)
        s = self.samples
        states = s.states[rows]
        return ThinnedEpisodes(
            Samples(
                s.returns[rows], states, owner, s.step[rows], s.rewards[rows], s.actions[rows],
                s.sources[which], s.lengths[which],
                None if s.next_states is None else s.next_states[rows],
            ),
            self.mean_returns[which],
            self.totals[which],
            self.extreme_rewards[which],
            self.mean_states[present],
            _ranges([states]),
            self.prints[compared],
            printed,
            self.places[which],
        )  # fmt: skip


def thinned(episodes: Sequence[Episode], gamma: float, plan: Plan) -> ThinnedEpisodes:
    """Return some episodes, thinned by the plan for them.

    Parameters
    ----------
    episodes : sequence of Episode
    gamma : float
        Discount factor of the return.
    plan : Plan

    Raises
    ------
    ValueError
        If gamma is invalid, or the rewards are so large that a return overflows.

    """
    returns = returns_of(episodes, gamma)
    samples = samples_of(episodes, returns, plan.kept, with_next=plan.with_next)
    present = [episodes[i] for i in np.unique(samples.owner)]
    compared = list(compress(episodes, plan.is_compared))
    prints = [fingerprints_of_runs(np.column_stack([e.states, e.rewards])) for e in compared]
    return ThinnedEpisodes(
        samples,
        np.array([of_episode.mean() for of_episode in returns]),
        np.array([e.rewards.sum() for e in episodes]),
        np.array([[e.rewards.min(), e.rewards.max()] for e in episodes]),
        np.array([e.states.mean(axis=0) for e in present]).reshape(-1, samples.states.shape[1]),
        _ranges([e.states for e in episodes]),
        np.concatenate([np.empty(0, np.uint64), *prints]),
        np.repeat(np.flatnonzero(plan.is_compared), [len(of_one) for of_one in prints]),
        np.arange(len(episodes)),
    )


def joined(parts: Sequence[ThinnedEpisodes]) -> ThinnedEpisodes:
    """Return the thinned episodes of all parts, which have the same channels and actions."""
    firsts = np.cumsum([0, *(len(part) for part in parts[:-1])])
    whole = _concatenated(parts)
    for name in ('printed', 'places'):
        numbers = [getattr(part, name) + i for part, i in zip(parts, firsts, strict=True)]
        whole[name] = np.concatenate(numbers)
    samples = _concatenated([part.samples for part in parts])
    owners = [part.samples.owner + i for part, i in zip(parts, firsts, strict=True)]
    samples['owner'] = np.concatenate(owners)
    whole |= {'samples': Samples(**samples), 'ranges': _ranges([whole['ranges']])}
    return ThinnedEpisodes(**whole)


def _concatenated(parts: Sequence) -> dict[str, np.ndarray]:
    """Return the arrays of data classes, concatenated, by the names of their fields."""
    arrays = {f.name: [getattr(part, f.name) for part in parts] for f in fields(parts[0])}
    return {
        name: np.concatenate(of_parts)
        for name, of_parts in arrays.items()
        if isinstance(of_parts[0], np.ndarray)
    }


def _ranges(states: Sequence[np.ndarray]) -> np.ndarray:
    """Return the least and the greatest value of each column of arrays (n, v): shape (2, v)."""
    least = np.min([of_one.min(axis=0) for of_one in states], axis=0)
    return np.stack([least, np.max([of_one.max(axis=0) for of_one in states], axis=0)])


def _among(which: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of some episodes, and their owners as indices of these."""
    rows = np.flatnonzero(np.isin(owner, which))
    return rows, np.searchsorted(which, owner[rows])
