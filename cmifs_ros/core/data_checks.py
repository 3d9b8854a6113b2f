# SPDX-License-Identifier: Apache-2.0

"""Warnings about what the data cannot show, with remedies."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from .drift import independent_episodes, share_of_drift
from .thinning import ThinnedEpisodes
from .words import counted, first, listed, short

#: Warn if at least this share of the variance of the episodes' mean returns is slow drift.
_MUCH_DRIFT = 0.5
#: Warn if a single reward makes up at least this share of the variance of all rewards.
_MUCH_OF_ONE = 0.5
#: Warn if the number of independent episodes is below this share of their number.
_FEW_INDEPENDENT = 0.5
#: Warn if at least this share of the runs of steps is in an earlier episode, too.
_MUCH_OVERLAP = 0.05
#: Warn about channels with at least this share of the variance of their episode means between
#: sources, if the return has at least this share, too.
_MUCH_BETWEEN, _SOME_BETWEEN = 0.9, 0.2
#: Warn if the channels predict at least this share of the action's variance.
_MUCH_PREDICTED = 0.5
#: Warn if the previous action predicts at least this share: as with commands that last two steps.
_MUCH_REPEATED = 0.25
#: Most channels that predict an action together, chosen from so many that predict it best alone.
_MAX_PREDICTORS, _MAX_COMPARED = 3, 5
#: Returns the share of each action's variance that channels predict.
Shares = Callable[[list[int]], dict[str, float]]


def problems_of_data(
    episodes: ThinnedEpisodes, names: Sequence[str], *, ordered: bool
) -> list[str]:
    """Return warnings about errors in the episodes, or limits of what they can show.

    Parameters
    ----------
    episodes : ThinnedEpisodes
    names : sequence of str
        Names of the channels.
    ordered : bool
        Whether they are in the order of time.

    """
    problems = _problems_of_rewards(episodes) + _problems_of_overlap(episodes)
    problems += _problems_of_sources(episodes, names) + _problems_of_rare(episodes, names)
    if ordered:
        problems += _problems_of_order(episodes.mean_returns)
    return problems


def problems_of_pooling(
    episodes: ThinnedEpisodes, recordings: npt.ArrayLike, names: Sequence[str]
) -> list[str]:
    """Return a warning about recordings without a source that may be of different robots.

    Parameters
    ----------
    episodes : ThinnedEpisodes
    recordings : array_like of int, shape (M,)
        The recording of each episode.
    names : sequence of str
        Names of the channels.

    """
    difference = _difference_between('recording', recordings, episodes, names)
    if not difference or np.any(episodes.samples.sources != ''):
        return []
    return [
        f'{difference}, which therefore may seem informative: if the recordings are of several '
        'robots, use --source bag'
    ]


def problems_of_skill(predicted_shares: Shares, num_channels: int, num_actions: int) -> list[str]:
    """Return which actions a few channels predict so well that the return shows little.

    Only what they predict beyond the previous action counts: a gyro or wheel speeds show that,
    however the robot is controlled.

    Parameters
    ----------
    predicted_shares : callable
        Returns the share of each action's variance that channels predict, by name. The previous
        action follows the channels of the state.
    num_channels : int
        Number of channels of the state.
    num_actions : int

    """
    _, beyond = _beyond_previous(predicted_shares, num_channels, num_actions)
    best = _best_shares(beyond, num_channels)
    skilled = {action: share for action, share in best.items() if share >= _MUCH_PREDICTED}
    said = [f'{share:.0%} of {short(action)}' for action, share in skilled.items()]
    if not said:
        return []
    return [
        f'the action follows from the sensors (given the previous one, they predict {first(said)})'
        ': if a controller always acts alike, the return cannot show what it needs its sensors '
        "for; target 'action' finds which ones it uses"
    ]


def problems_of_held_actions(
    predicted_shares: Shares, num_channels: int, num_actions: int
) -> list[str]:
    """Return which actions follow from the previous one rather than from the sensors.

    Parameters
    ----------
    predicted_shares, num_channels, num_actions
        As in `problems_of_skill`.

    """
    known, beyond = _beyond_previous(predicted_shares, num_channels, num_actions)
    if all(share < _MUCH_REPEATED for share in known.values()):
        return []
    best = _best_shares(beyond, num_channels)
    said = [
        f'{short(action)}: {share:.0%} of its variance'
        for action, share in known.items()
        if share >= _MUCH_REPEATED and best[action] < _MUCH_PREDICTED
    ]
    if not said:
        return []
    return [
        f'the action follows from the previous one ({first(said)}): sensors that show the '
        'previous action, such as wheel speeds or a gyro, then predict it whether or not the '
        'controller uses them; make steps about as long as a command'
    ]


def _beyond_previous(
    predicted_shares: Shares, num_channels: int, num_actions: int
) -> tuple[dict[str, float], Shares]:
    """Return the share of each action that the previous action predicts, and a function.

    The function returns the share of the rest that channels predict.
    """
    previous = list(range(num_channels, num_channels + num_actions))
    known = predicted_shares(previous)

    def beyond(channels: list[int]) -> dict[str, float]:
        shares = predicted_shares([*channels, *previous])
        return {a: (s - known[a]) / max(1 - known[a], 1e-6) for a, s in shares.items()}

    return known, beyond


def _best_shares(shares: Shares, num_channels: int) -> dict[str, float]:
    """Return the share of each action that its best few channels predict."""
    alone = [shares([channel]) for channel in range(num_channels)]
    return {
        action: _best_share(shares, action, [of_one[action] for of_one in alone])
        for action in alone[0]
    }


def _best_share(predicted_shares: Shares, action: str, alone: Sequence[float]) -> float:
    """Return the share that a few channels predict together.

    They are chosen from those that predict most alone, each as the best given the previous ones.
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


def _problems_of_rewards(episodes: ThinnedEpisodes) -> list[str]:
    rewards, extremes = episodes.samples.rewards, episodes.extreme_rewards
    middle = np.median(rewards / 2)  # halved: no overflow
    distances, greatest = np.abs(rewards / 2 - middle), np.abs(extremes / 2 - middle)
    size = max(greatest.max(), np.finfo(float).tiny)
    episode, which = divmod(int(greatest.argmax()), 2)
    # In units of the greatest; the kept steps stand for all.
    squares = (distances / size) ** 2 * (episodes.num_steps / len(rewards))
    others = squares.sum() - squares.max()
    if not 0 < others < (1 - _MUCH_OF_ONE) / _MUCH_OF_ONE:
        return []
    return [
        f'1 reward of {extremes[episode, which]:g} in episode {episodes.places[episode]} makes up '
        f'{1 / (1 + others):.0%} of the variance of the rewards: effect sizes are mostly about it; '
        'leave the episode out if it is an error'
    ]


def _problems_of_overlap(episodes: ThinnedEpisodes) -> list[str]:
    """Return a warning about runs of steps in two episodes; needs a continuous channel.

    Episodes may begin alike, as in a simulation that is reset. So a run that is at the same step in
    both counts only if such runs make up most of an episode.
    """
    states = episodes.samples.states
    if max(len(np.unique(column)) for column in states.T) < len(states) / 4:
        return []
    _, first, which = np.unique(episodes.prints, return_index=True, return_inverse=True)
    owner = episodes.printed
    step = np.arange(len(owner)) - np.searchsorted(owner, owner)
    is_repeated = (owner[first][which] != owner) & (episodes.prints != 0)
    is_alike = is_repeated & (step[first][which] == step)
    is_most = 2 * np.bincount(owner, is_alike) > np.bincount(owner)
    repeated = (is_repeated & (~is_alike | is_most[owner])).sum()
    if repeated <= _MUCH_OVERLAP * len(which):
        return []
    return [
        f'{repeated / len(which):.0%} of the steps are in two episodes, as with overlapping '
        'windows or a drive recorded twice, and count twice: use windows that do not overlap'
    ]


def _problems_of_rare(episodes: ThinnedEpisodes, names: Sequence[str]) -> list[str]:
    """Return a warning about channels that change, but in none of the kept steps."""
    unseen = (np.ptp(episodes.ranges, axis=0) > 0) & (np.ptp(episodes.samples.states, axis=0) == 0)
    rare = [names[c] for c in np.flatnonzero(unseen)]
    if not rare:
        return []
    return [
        f'too rare to be judged: {listed(rare)} {"change" if len(rare) > 1 else "changes"} in none '
        f'of the {len(episodes.samples.step)} steps used, of {episodes.num_steps}; select '
        'from the episodes in which it does'
    ]


def _problems_of_sources(episodes: ThinnedEpisodes, names: Sequence[str]) -> list[str]:
    """Return a warning about channels that differ mostly between sources, like the return."""
    difference = _difference_between('source', episodes.samples.sources, episodes, names)
    if not difference:
        return []
    return [
        f'{difference}: differences between sources are no evidence, because robots differ in many '
        'ways; record more robots, or each robot under several conditions'
    ]


def _difference_between(
    what: str, groups: npt.ArrayLike, episodes: ThinnedEpisodes, names: Sequence[str]
) -> str:
    """Return how the return and some channels differ between groups; empty unless both do."""
    _, group = np.unique(groups, return_inverse=True)
    num_groups, count = group.max() + 1, len(episodes)
    if not 1 < num_groups < count:
        return ''
    # Group means alone explain (num_groups - 1) / (count - 1) of any variable by chance.
    of_return = _share_between(episodes.mean_returns[:, None], group)[0]
    if of_return <= max(_SOME_BETWEEN, 3 * (num_groups - 1) / (count - 1)):
        return ''
    shares = _share_between(episodes.mean_states, group[np.unique(episodes.samples.owner)])
    differing = [f'{names[c]} ({s:.0%})' for c, s in enumerate(shares) if s >= _MUCH_BETWEEN]
    if not differing:
        return ''
    return (
        f'the return differs between the {num_groups} {what}s ({of_return:.0%} of the variance '
        f'between episodes), and so {"do" if len(differing) > 1 else "does"} {listed(differing)}'
    )


def _share_between(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the share of the variance of values (M, k) that is between groups: (k,)."""
    counts = np.bincount(groups)
    means = np.stack([np.bincount(groups, column) for column in values.T], axis=1)
    means = (means / counts[:, None])[groups]
    return means.var(axis=0) / np.maximum(values.var(axis=0), np.finfo(float).tiny)


def _problems_of_order(means: np.ndarray) -> list[str]:
    count = len(means)
    means = means / max(np.abs(means).max(), np.finfo(float).tiny)  # Squares do not overflow.
    drift, worth = share_of_drift(means, np.ones(count)), independent_episodes(means)
    problems = []
    if drift > _MUCH_DRIFT:
        problems.append(
            f'the return follows the order of the episodes ({drift:.0%} of its variance between '
            'episodes is slow drift): sensors that drift along have no evidence'
        )
    if worth < _FEW_INDEPENDENT * count:
        problems.append(
            f'{counted(count, "episode")} resemble their neighbours, as windows of one drive do, '
            f'so they count as about {worth:.0f} independent ones'
        )
    if problems:
        problems[-1] += (
            '; only if the order of the episodes means nothing, for example in files sorted by '
            'outcome, use --order none (ordered=False)'
        )
    return problems
