# SPDX-License-Identifier: Apache-2.0

"""A selection: a function of settings and episodes, and its result as plain data."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .changing_task import num_outdated
from .conditional_mi_selector import ConditionalMISelector
from .effect import Effect
from .episode import Episode
from .kdr_selector import KDRSelector
from .sensor_selector import SensorSelector
from .statuses import CONFIRMED, DISPENSABLE, UNDECIDED
from .targets import RETURN
from .thinning import ThinnedEpisodes

METHODS = {'conditional_mi': ConditionalMISelector, 'kdr': KDRSelector}


@dataclass(frozen=True)
class SensorResult:
    """The result for one sensor. Values that the method does not estimate are None or empty.

    Attributes
    ----------
    name : str
    channels : tuple of str
        All channels of the sensor.
    is_selected : bool
        Whether it is selected.
    score : float
        The score of the sensor together with those ranked before it; if it was tested but not
        selected, together with all selected ones.
    is_constant : bool
        Whether none of its channels ever changed, so that it was not tested.
    null_band : (float, float, float) or None
        The score of an uninformative sensor at the same rank: 5 %, median, 95 %.
    pvalue : float or None
        p-value of the hypothesis that the sensor is uninformative given the other selected ones,
        corrected for the number of sensors.
    status : str or None
        One of `STATUSES`.
    supporting_channels : tuple of str
        The channels that carry the evidence: all, or the informative ones of a large group.
    redundant_with : tuple of str
        Confirmed sensors; without one of these there would be strong evidence for this one. A copy
        is redundant with its original.
    stability : float or None
        Share of random halves of the episodes in which the sensor is selected.
    effect : Effect or None
    together_with : tuple of str
        Other unconfirmed sensors together with which it may add the margin or more, although it
        adds less alone.
    why : str
        What the sensor is needed for.

    """

    name: str
    channels: tuple[str, ...]
    is_selected: bool
    score: float
    is_constant: bool = False
    null_band: tuple[float, float, float] | None = None
    pvalue: float | None = None
    status: str | None = None
    supporting_channels: tuple[str, ...] = ()
    redundant_with: tuple[str, ...] = ()
    stability: float | None = None
    effect: Effect | None = None
    why: str = ''
    together_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class Selection:
    """The result of a selection, which all outputs show: the sensors and their evidence.

    Attributes
    ----------
    indices : tuple of int
        Selected channels, best sensor first.
    sensors : tuple of SensorResult
        All ranked sensors, best first.
    episodes, steps : int
        Size of the data used.
    seconds : float
        Computing time.
    means, spreads : tuple of float
        Mean in these data of each channel and, last, of the reward, and how far they go: their
        standard deviation or, if it is greater, as of a battery that drains, twice the range of
        their means in the three thirds of the data. Empty if these data were cleared.
    outdated : int
        Number of the oldest episodes that no longer fit the newest and were left out.
    number : int
        Running number of a selection that a node uses; 0 if it is not in use.
    target : str
        The question; see `targets`.
    gamma : float or None
        Discount factor per step of the return; None with another target.
    predicted_share, predicted_share_of_all, predicted_share_of_none : float or None
        Share of the target's variance that the selected sensors, all sensors, and none predict in
        held-out episodes, each together with the step and the action.
    warnings : tuple of str
        What the data cannot show.
    margin : float or None
        A sensor that adds less than this share of the target's variance is dispensable.
    level : float or None
        The greatest p-value that confirms a sensor. A node divides its significance among all
        selections of a task.
    losses : str
        How the loss of episodes depended on their end; empty if it did not. Then the episodes left
        are biased, and no sensor is dispensable.
    doubt : str
        Why it may no longer hold, such as changed data; empty if nothing suggests that.

    """

    indices: tuple[int, ...]
    sensors: tuple[SensorResult, ...]
    episodes: int
    steps: int
    seconds: float
    means: tuple[float, ...] = ()
    spreads: tuple[float, ...] = ()
    outdated: int = 0
    number: int = 0
    target: str = RETURN
    gamma: float | None = None
    predicted_share: float | None = None
    predicted_share_of_all: float | None = None
    predicted_share_of_none: float | None = None
    warnings: tuple[str, ...] = ()
    margin: float | None = None
    level: float | None = None
    losses: str = ''
    doubt: str = ''

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the selected channels, in the order of `indices`."""
        return tuple(name for s in self.sensors if s.is_selected for name in s.channels)

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the selected sensors, best first."""
        return tuple(sensor.name for sensor in self.sensors if sensor.is_selected)

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of all sensors, best first."""
        return tuple(sensor.name for sensor in self.sensors)

    @property
    def scores(self) -> tuple[float, ...]:
        """Scores of all sensors, in the order of `ranking`."""
        return tuple(sensor.score for sensor in self.sensors)

    @property
    def confirmed(self) -> tuple[str, ...]:
        """Names of the confirmed sensors."""
        return tuple(sensor.name for sensor in self.sensors if sensor.status == CONFIRMED)

    @property
    def changing(self) -> tuple[SensorResult, ...]:
        """The sensors that are not constant; the others have no score of their own."""
        return tuple(sensor for sensor in self.sensors if not sensor.is_constant)


def select(
    episodes: Sequence[Episode] | ThinnedEpisodes,
    channel_names: Sequence[str],
    method: str,
    settings: dict,
    *,
    action_names: Sequence[str] | None = None,
    ordered: bool = True,
    start: Collection[str] = (),
    num_halves: int = 0,
    least_kept: int | None = None,
    losses: str = '',
    progress: Callable[[float], None] = lambda fraction: None,
) -> Selection:
    """Fit the selector of a method with the given settings, and return the result.

    Parameters
    ----------
    episodes : sequence of Episode or ThinnedEpisodes
        Thinned ones for the method 'conditional_mi' only.
    channel_names : sequence of str
    method : str
        One of `METHODS`.
    settings : dict
        Parameters of the selector.
    action_names, ordered
        As of `ConditionalMISelector.fit`; KDR ignores them.
    start : collection of str
        Sensors of an earlier selection.
    num_halves : int
        Number of random halves of the episodes for `SensorResult.stability`.
    least_kept : int, optional
        If the task has changed, leave out the oldest episodes, but none of the newest `least_kept`.
        None, or a method without a test, leaves out none.
    losses : str
        As of `Selection`; it becomes a warning.
    progress : callable
        Called with the completed share.

    """
    begin = time.perf_counter()
    options: dict[str, Any] = {'names': channel_names}
    selector = METHODS[method](**settings)
    data: Any = episodes
    if isinstance(selector, ConditionalMISelector):
        options |= {'action_names': action_names, 'ordered': ordered}
        data = episodes if isinstance(episodes, ThinnedEpisodes) else selector.thin(episodes)
    _fit(selector, data, start=start, progress=progress, **options)
    outdated = 0
    if least_kept is not None and _has_test(selector):
        pairs = zip(selector.supporting_channels_, selector.pvalues_, strict=True)
        oldest = num_outdated(
            data,
            [channel for channels, pvalue in pairs if pvalue < 1 for channel in channels],
            least_kept=least_kept,
            gamma=selector.gamma,
            random_state=selector.random_state,
            target=selector.target,
        )
        if oldest:
            outdated = int(data.places[oldest])
            data = data.only(np.arange(oldest, len(data)))
            _fit(selector, data, progress=progress, **options)  # The start is of another task.
    progress(1.0)
    if isinstance(data, ThinnedEpisodes):
        samples = np.column_stack([data.samples.states, data.samples.rewards])
        num_steps = data.num_steps
    else:
        samples = np.concatenate([np.column_stack([e.states, e.rewards]) for e in data])
        num_steps = len(samples)
    with np.errstate(over='ignore', invalid='ignore'):  # The spread of huge values is inf.
        means = samples.mean(axis=0)
        thirds = [part.mean(axis=0) for part in np.array_split(samples, 3) if len(part)]
        spreads = np.fmax(samples.std(axis=0), 2 * np.ptp(thirds, axis=0))
    stability = _stability(selector, data, options, num_halves)
    sensors, said = _results(selector, stability), tuple(getattr(selector, 'warnings_', ()))
    if losses:
        said = (f'{losses}; the episodes left are biased, so no sensor is dispensable', *said)
        sensors = tuple(
            replace(sensor, status=UNDECIDED) if sensor.status == DISPENSABLE else sensor
            for sensor in sensors
        )
    target = selector.target if method == 'conditional_mi' else RETURN
    return Selection(
        indices=tuple(selector.get_support(indices=True).tolist()),
        sensors=sensors,
        episodes=len(data),
        steps=num_steps,
        seconds=time.perf_counter() - begin,
        means=tuple(means.tolist()),
        spreads=tuple(spreads.tolist()),
        outdated=outdated,
        target=target,
        gamma=getattr(selector, 'gamma', None) if target == RETURN else None,
        predicted_share=getattr(selector, 'predicted_share_', None),
        predicted_share_of_all=getattr(selector, 'predicted_share_of_all_', None),
        predicted_share_of_none=getattr(selector, 'predicted_share_of_none_', None),
        warnings=said,
        margin=selector.margin if _has_test(selector) else None,
        level=selector.significance if _has_test(selector) else None,
        losses=losses,
    )


def _only(episodes: Sequence[Episode] | ThinnedEpisodes, which: np.ndarray):
    if isinstance(episodes, ThinnedEpisodes):
        return episodes.only(which)
    return [episodes[i] for i in which]


def _fit(selector: SensorSelector, episodes, **options) -> None:
    """Fit without Python's warnings: the selection contains them."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', UserWarning)
        selector.fit(episodes, **options)


def _has_test(selector: SensorSelector) -> bool:
    """Return whether the method, with these settings, tests the sensors that it ranks."""
    return len(getattr(selector, 'pvalues_', ())) > 0


def _results(selector: SensorSelector, stability: np.ndarray | None) -> tuple[SensorResult, ...]:
    """Return the selector's result for each sensor, best first."""
    names = selector.feature_names_in_
    results = [
        SensorResult(
            name=selector.sensor_names_[sensor],
            channels=tuple(names[channel] for channel in selector.sensor_channels_[sensor]),
            is_selected=place < selector.num_features_,
            score=float(selector.scores_[place]),
            stability=None if stability is None else float(stability[sensor]),
        )
        for place, sensor in enumerate(selector.ranking_)
    ]
    if _has_test(selector):
        results = [_with_evidence(selector, place, sensor) for place, sensor in enumerate(results)]
    return tuple(results)


def _with_evidence(selector, place: int, sensor: SensorResult) -> SensorResult:
    supporting = selector.supporting_channels_[place]
    return replace(
        sensor,
        is_constant=not supporting,
        null_band=tuple(selector.null_scores_[place].tolist()) if supporting else None,
        pvalue=float(selector.pvalues_[place]),
        status=selector.statuses_[place],
        effect=selector.effects_[place],
        why=selector.why_[place],
        supporting_channels=tuple(selector.feature_names_in_[channel] for channel in supporting),
        redundant_with=tuple(selector.sensor_names_[i] for i in selector.redundant_with_[place]),
        together_with=tuple(selector.sensor_names_[i] for i in selector.together_with_[place]),
    )


def _stability(selector, episodes, options: dict, num_halves: int) -> np.ndarray | None:
    """Return the share of random halves of the episodes in which each sensor is selected: (S,).

    Meinshausen & Buehlmann, Stability selection, 2010.
    """
    if not num_halves:
        return None
    rng = np.random.default_rng([selector.random_state, 4])
    counts = np.zeros(len(selector.sensor_names_))
    for _ in range(num_halves):
        half = np.sort(rng.permutation(len(episodes))[: -(-len(episodes) // 2)])
        again = type(selector)(**selector.get_params())
        _fit(again, _only(episodes, half), **options)
        counts[again.ranking_[: again.num_features_]] += 1
    return counts / num_halves
