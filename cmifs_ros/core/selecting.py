# SPDX-License-Identifier: Apache-2.0

"""Select by any method: a function from settings and episodes to a plain result."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .changing_task import num_outdated
from .conditional_mi_selector import ConditionalMISelector
from .episode import Episode
from .kdr_selector import KDRSelector
from .selection import Selection, SensorResult
from .sensor_selector import SensorSelector
from .statuses import DISPENSABLE, UNDECIDED
from .targets import RETURN
from .thinning import ThinnedEpisodes

METHODS = {'conditional_mi': ConditionalMISelector, 'kdr': KDRSelector}


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
