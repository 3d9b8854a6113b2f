"""One selection as a job: settings and episodes in, a plain result out."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from .changing_task import num_outdated
from .conditional_mi_selector import CONFIRMED, REJECTED, ConditionalMISelector
from .episode import Episode
from .kdr_selector import KDRSelector

METHODS = {'conditional_mi': ConditionalMISelector, 'kdr': KDRSelector}


@dataclass(frozen=True)
class Selection:
    """What was selected, and on what evidence: the one result that everything shows.

    Attributes
    ----------
    indices : tuple of int
        Selected channels, best sensor first.
    names : tuple of str
        Their names.
    ranking : tuple of str
        Names of all sensors that were ranked, best first; what is below is in the same order.
    scores : tuple of float
        The criterion of each sensor with those taken before it; with all that were selected for
        one that was not.
    statuses : tuple of str
        'confirmed': tells something about the return that the others selected do not;
        'tentative': not shown so far; 'rejected': no evidence that it does.
    pvalues : tuple of float
        Of the hypothesis that the sensor tells nothing beside the others selected, corrected for
        the number of sensors; small is evidence.
    null_scores : tuple of (float, float, float)
        The score that a sensor telling nothing would have at the same place: 5 %, median, 95 %.
    supporting_channels : tuple of tuple of str
        The channels that support the sensor: all of it, or those of a group that tell something.
    redundant_with : tuple of tuple of str
        The confirmed sensors that the sensor is redundant with: without one of these there would
        be strong evidence for it. A copy, or another reading of the same.
    stability : tuple of float
        Share of random halves of the episodes in which the sensor is selected; empty if not asked.
    outdated : int
        Of the oldest episodes, how many no longer fit the newest, and were left out.
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
    statuses: tuple[str, ...] = ()
    pvalues: tuple[float, ...] = ()
    null_scores: tuple[tuple[float, float, float], ...] = ()
    supporting_channels: tuple[tuple[str, ...], ...] = ()
    redundant_with: tuple[tuple[str, ...], ...] = ()
    stability: tuple[float, ...] = ()
    outdated: int = 0

    @property
    def confirmed(self) -> tuple[str, ...]:
        """Names of the sensors that are confirmed."""
        pairs = zip(self.ranking, self.statuses, strict=False)
        return tuple(name for name, status in pairs if status == CONFIRMED)

    @property
    def num_live(self) -> int:
        """How many sensors, the first of the ranking, ever changed: the rest has no score."""
        return len(self.ranking) - self.supporting_channels.count(())


def select(
    episodes: Sequence[Episode],
    channel_names: Sequence[str],
    method: str,
    settings: dict,
    *,
    start: Collection[str] = (),
    num_halves: int = 0,
    least_kept: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Selection:
    """Fit the selector of a method, with the given settings, and return what it found.

    Parameters
    ----------
    episodes : sequence of Episode
    channel_names : sequence of str
    method : str
        One of `METHODS`.
    settings : dict
        Parameters of the selector.
    start : collection of str
        Sensors of an earlier selection.
    num_halves : int
        How many random halves of the episodes to select from for `Selection.stability`.
    least_kept : int, optional
        Where the task has changed, leave out the oldest episodes, but none of the newest
        `least_kept`. None leaves out none, nor does a method without evidence.
    progress : callable
        Told the share that is done.

    """
    begin = time.perf_counter()
    selector = METHODS[method](**settings)
    selector.fit(episodes, names=channel_names, start=start, progress=progress)
    outdated = 0
    if least_kept is not None and len(getattr(selector, 'pvalues_', ())):
        pairs = zip(selector.supporting_channels_, selector.statuses_, strict=True)
        outdated = num_outdated(
            episodes,
            [channel for channels, status in pairs if status != REJECTED for channel in channels],
            least_kept=least_kept,
            gamma=selector.gamma,
            random_state=selector.random_state,
        )
    if outdated:
        episodes = episodes[outdated:]
        selector.fit(episodes, names=channel_names, start=start, progress=progress)
    progress(1.0)
    samples = np.concatenate([np.column_stack([e.states, e.rewards]) for e in episodes])
    with np.errstate(over='ignore', invalid='ignore'):  # Huge values: their spread is inf.
        means, spreads = samples.mean(axis=0), samples.std(axis=0)
    evidence = {}
    if len(getattr(selector, 'pvalues_', ())):
        evidence = {
            'statuses': tuple(selector.statuses_),
            'pvalues': tuple(selector.pvalues_.tolist()),
            'null_scores': tuple(map(tuple, selector.null_scores_.tolist())),
            'supporting_channels': tuple(
                tuple(channel_names[c] for c in s) for s in selector.supporting_channels_
            ),
            'redundant_with': tuple(
                tuple(selector.sensor_names_[i] for i in s) for s in selector.redundant_with_
            ),
        }
    return Selection(
        indices=tuple(selector.get_support(indices=True).tolist()),
        names=tuple(selector.get_feature_names_out()),
        ranking=tuple(selector.sensor_names_[i] for i in selector.ranking_),
        scores=tuple(selector.scores_.tolist()),
        episodes=len(episodes),
        steps=sum(map(len, episodes)),
        seconds=time.perf_counter() - begin,
        means=tuple(means.tolist()),
        spreads=tuple(spreads.tolist()),
        stability=_stability(selector, episodes, channel_names, num_halves),
        outdated=outdated,
        **evidence,
    )


def _stability(selector, episodes, channel_names, num_halves: int) -> tuple[float, ...]:
    """Return the share of random halves of the episodes in which each ranked sensor is selected.

    Meinshausen & Buehlmann, Stability selection, 2010.
    """
    if not num_halves:
        return ()
    rng = np.random.default_rng([selector.random_state, 4])
    counts = np.zeros(len(selector.sensor_names_))
    for _ in range(num_halves):
        half = np.sort(rng.permutation(len(episodes))[: -(-len(episodes) // 2)])
        again = type(selector)(**selector.get_params())
        again.fit([episodes[i] for i in half], names=channel_names)
        counts[again.ranking_[: again.num_features_]] += 1
    return tuple((counts[selector.ranking_] / num_halves).tolist())
