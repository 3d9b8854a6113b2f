# SPDX-License-Identifier: Apache-2.0

"""Warnings about what the data cannot show, with remedies."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .drift import share_of_drift
from .episode import Episode
from .returns import discounted_returns
from .words import counted, first, listed, short

#: Warn if at least this share of the variance of the episodes' mean returns is slow drift.
_MUCH_DRIFT = 0.5
#: Warn if a single reward makes up at least this share of the variance of all rewards.
_MUCH_OF_ONE = 0.5
#: Warn if the effective number of episodes is below this share of their number.
_FEW_INDEPENDENT = 0.5
#: Length of a run of steps that counts as repeated; warn if at least this share of steps is.
_RUN, _MUCH_OVERLAP = 3, 0.05
#: Number of runs compared.
_MAX_RUNS = 100_000
#: Warn about channels with at least this share of the variance of their episode means between
#: sources, if the return has at least this share, too.
_MUCH_BETWEEN, _SOME_BETWEEN = 0.9, 0.2
#: Warn if the channels predict at least this share of the action's variance.
_MUCH_PREDICTED = 0.5
#: Most channels that predict an action together, chosen from so many that predict it best alone.
_MAX_PREDICTORS, _MAX_COMPARED = 3, 5
#: Returns the share of each action's variance that channels predict.
Shares = Callable[[list[int]], dict[str, float]]


def independent_episodes(episodes: Sequence[Episode], gamma: float) -> float:
    """Return the effective number of independent episodes, from their mean returns in order.

    This is their number divided by the integrated autocorrelation time, whose sum is cut where two
    neighbouring autocorrelations have a negative sum (Geyer, Practical Markov chain Monte Carlo,
    1992).
    """
    means = _mean_returns(episodes, gamma)
    means = means - means.mean()
    count, variance = len(means), means @ means
    if variance <= 0:
        return float(count)
    padded = np.fft.rfft(means, 2 * count)
    correlations = np.fft.irfft(padded * padded.conj())[:count] / variance
    pairs = correlations[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    cut = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    time = max(2 * pairs[:cut].sum() - 1, 1.0)
    return float(max(count / time, 1.0))


def problems_of_data(
    episodes: Sequence[Episode], names: Sequence[str], gamma: float, *, ordered: bool
) -> list[str]:
    """Return warnings about errors in the episodes, or limits of what they can show.

    Parameters
    ----------
    episodes : sequence of Episode
    names : sequence of str
        Names of the channels.
    gamma : float
        Discount factor of the return.
    ordered : bool
        Whether they are in the order of time.

    """
    problems = _problems_of_rewards(episodes) + _problems_of_overlap(episodes)
    problems += _problems_of_sources(episodes, names, gamma)
    if ordered:
        problems += _problems_of_order(episodes, gamma)
    return problems


def problems_of_skill(predicted_shares: Shares, num_channels: int) -> list[str]:
    """Return which actions a few channels predict so well that the return shows little.

    Parameters
    ----------
    predicted_shares : callable
        Returns the share of each action's variance that channels predict, by name.
    num_channels : int

    """
    alone = [predicted_shares([channel]) for channel in range(num_channels)]
    best = {
        action: _best_share(predicted_shares, action, [of_one[action] for of_one in alone])
        for action in predicted_shares([])
    }
    skilled = {action: share for action, share in best.items() if share >= _MUCH_PREDICTED}
    if not skilled:
        return []
    said = [f'{short(action)}: {share:.0%} of its variance' for action, share in skilled.items()]
    return [
        f'the action follows from the sensors ({first(said)}): if a controller always acts alike, '
        "the return cannot show what its sensors are good for; target 'action' finds what the "
        'controller looks at'
    ]


def _best_share(predicted_shares: Shares, action: str, alone: Sequence[float]) -> float:
    """Return the share that few channels predict, of those that predict most alone.

    Each is the best given the previous ones.
    """
    compared = sorted(range(len(alone)), key=lambda c: -alone[c])[:_MAX_COMPARED]
    chosen, best = compared[:1], alone[compared[0]]
    while len(chosen) < min(_MAX_PREDICTORS, len(compared)) and best < _MUCH_PREDICTED:
        rest = (c for c in compared if c not in chosen)
        shares = {c: predicted_shares([*chosen, c])[action] for c in rest}
        channel = max(shares, key=shares.__getitem__)
        if shares[channel] <= best:
            break
        chosen, best = [*chosen, channel], shares[channel]
    return best


def _mean_returns(episodes, gamma):
    return np.array([discounted_returns(e.rewards, gamma).mean() for e in episodes])


def _is_autocorrelated(means: np.ndarray) -> bool:
    """Return whether neighbours correlate by more than three standard errors of white noise."""
    means = means - means.mean()
    return means[1:] @ means[:-1] > 3 / np.sqrt(len(means)) * (means @ means)


def _problems_of_rewards(episodes) -> list[str]:
    rewards = np.concatenate([episode.rewards for episode in episodes])
    distances = np.abs(rewards / 2 - np.median(rewards / 2))  # halved: no overflow
    squares = (distances / max(distances.max(), np.finfo(float).tiny)) ** 2
    greatest = int(squares.argmax())
    if squares[greatest] <= _MUCH_OF_ONE * squares.sum() or (squares > 0).sum() < 2:
        return []
    lengths = np.array([len(episode) for episode in episodes])
    episode = int(np.searchsorted(np.cumsum(lengths), greatest, side='right'))
    share = squares[greatest] / squares.sum()
    return [
        f'1 reward of {rewards[greatest]:g} in episode {episode} makes up {share:.0%} of the '
        'variance of the rewards: effect sizes are mostly about it; leave the episode out if it '
        'is an error'
    ]


def _problems_of_overlap(episodes) -> list[str]:
    """Return a warning about runs of steps in two episodes; needs a continuous channel."""
    steps = [np.column_stack([e.states, e.rewards]) for e in episodes]
    states = np.concatenate([e.states for e in episodes])
    if max(len(np.unique(column)) for column in states.T) < len(states) / 4:
        return []
    found: dict[bytes, int] = {}
    total = repeated = 0
    for number, rows in enumerate(steps):
        if total >= _MAX_RUNS:
            break
        for t in range(len(rows) - _RUN + 1):
            total += 1
            repeated += found.setdefault(rows[t : t + _RUN].tobytes(), number) != number
    if repeated <= _MUCH_OVERLAP * total:
        return []
    return [
        f'{repeated / total:.0%} of the steps are in two episodes, as with overlapping windows or '
        'a drive recorded twice, and count twice: use windows that do not overlap'
    ]


def _problems_of_sources(episodes, names, gamma) -> list[str]:
    """Return a warning about channels that differ mostly between sources, like the return."""
    _, source = np.unique([episode.source for episode in episodes], return_inverse=True)
    num_sources, count = source.max() + 1, len(episodes)
    if not 1 < num_sources < count:
        return []
    # Group means alone explain (num_sources - 1) / (count - 1) of any variable by chance.
    of_return = _share_between(_mean_returns(episodes, gamma)[:, None], source)[0]
    if of_return <= max(_SOME_BETWEEN, 3 * (num_sources - 1) / (count - 1)):
        return []
    shares = _share_between(np.array([episode.states.mean(axis=0) for episode in episodes]), source)
    differing = [f'{names[c]} ({s:.0%})' for c, s in enumerate(shares) if s >= _MUCH_BETWEEN]
    if not differing:
        return []
    return [
        f'the return differs between the {num_sources} sources ({of_return:.0%} of the variance '
        f'between episodes), and so do {listed(differing)}: differences between sources are no '
        'evidence, because robots differ in many ways; record more robots, or each robot under '
        'several conditions'
    ]


def _share_between(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the share of the variance of values (M, k) that is between groups: (k,)."""
    counts = np.bincount(groups)
    means = np.stack([np.bincount(groups, column) for column in values.T], axis=1)
    means = (means / counts[:, None])[groups]
    return means.var(axis=0) / np.maximum(values.var(axis=0), np.finfo(float).tiny)


def _problems_of_order(episodes, gamma) -> list[str]:
    count = len(episodes)
    weights = np.ones(count)
    drift = share_of_drift(_mean_returns(episodes, gamma), weights)
    if drift > _MUCH_DRIFT:
        return [
            f'the return follows the order of the episodes ({drift:.0%} of its variance between '
            'episodes is slow drift), so sensors that drift along have no evidence; if the order '
            'means nothing, for example in files sorted by outcome, set ordered=False'
        ]
    worth = independent_episodes(episodes, gamma)
    if worth < _FEW_INDEPENDENT * count and _is_autocorrelated(_mean_returns(episodes, gamma)):
        return [
            f'{counted(count, "episode")} resemble their neighbours and are worth about '
            f'{worth:.0f} independent ones'
        ]
    return []
