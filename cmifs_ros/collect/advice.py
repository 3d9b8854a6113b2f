# SPDX-License-Identifier: Apache-2.0

"""Advice from a selection: which topics or sensors to keep, and which can go."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import NormalDist
from typing import Any

from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import Selection, SensorResult
from cmifs_ros.core.statuses import CONFIRMED, DISPENSABLE, FEWEST_EPISODES, UNDECIDED
from cmifs_ros.core.targets import ACTION, DECISION, RETURN
from cmifs_ros.core.words import counted, first, listed, short

from .selection_report import (
    FEW_EPISODES,
    LINE_WIDTH,
    PREDICTED,
    WIDE_INTERVAL,
    interval,
    share,
    undecided_because,
)
from .sensor_topics import rate_fields
from .traffic import Rate, rate_in_words

#: Error rate for which the number of further episodes is estimated: of calling a sensor that adds
#: the margin dispensable, and of confirming an uninformative one.
_ALPHA = 0.05
#: Largest excess of the standard error for which the number of episodes can be estimated.
_MAX_EXCESS = 100
#: Above this share of undecided sensors, another target is recommended.
_FEW = 0.25
#: If all sensors predict less than this many times the margin, the margin is no small part of it.
_LITTLE = 3.0
_SCOPES = {
    RETURN: 'This is about the return under the recorded controller. A controller that is to be '
    'learned or changed may need other sensors: target decision.',
    DECISION: 'This is about what a controller that is to be learned or changed needs, for the '
    'reward of this task.',
    ACTION: 'This is about what the recorded controller uses.',
}


@dataclass(frozen=True)
class Item:
    """A topic, or a sensor where topics are not known.

    Attributes
    ----------
    name : str
    notes : tuple of str
        What the sensors that decide its list add, and conditions for switching it off.
    rate : Rate or None
    more_episodes : int or None
        If undecided: roughly how many more would decide. None: unknown.

    """

    name: str
    notes: tuple[str, ...]
    rate: Rate | None = None
    more_episodes: int | None = None


@dataclass(frozen=True)
class Advice:
    """What to keep, what can go, and what is undecided; all empty if nothing was tested.

    `scope` is a sentence: which question the advice answers. `hints` are sentences that say what
    limits it, and how to decide what is undecided.
    """

    scope: str = ''
    keep: tuple[Item, ...] = ()
    can_go: tuple[Item, ...] = ()
    undecided: tuple[Item, ...] = ()
    hints: tuple[str, ...] = ()


def advice_of(
    selection: Selection,
    topics: Mapping[str, str] | None = None,
    rates: Mapping[str, Rate] | None = None,
    needed: Collection[str] = (),
) -> Advice:
    """Return advice from a selection.

    Selected and confirmed sensors are kept, because dispensable ones are so only given these, and
    so is what is needed in any case. A topic can go if all its channels can.

    Parameters
    ----------
    selection : Selection
    topics : mapping of str to str, optional
        The topic of each channel. Without it the advice is about sensors.
    rates : mapping of str to Rate, optional
        By topic, or by sensor without `topics`.
    needed : collection of str
        Topics needed for actions, steps, the reward or the ends of episodes.

    """
    if not any(sensor.status for sensor in selection.sensors):
        return Advice()
    owners = {channel: sensor for sensor in selection.sensors for channel in sensor.channels}
    if topics is None:
        members: dict[str, list[SensorResult | None]] = {s.name: [s] for s in selection.sensors}
    else:
        members = {}
        for channel, topic in topics.items():
            members.setdefault(topic, []).append(owners.get(channel))
    keep, can_go, undecided = [], [], []
    for name, found in members.items():
        sensors = list(dict.fromkeys(sensor for sensor in found if sensor is not None))
        rate = (rates or {}).get(name)
        if kept := [s for s in sensors if s.is_selected or s.status == CONFIRMED]:
            notes = _added(name, kept, _estimate)
            if all(sensor.status != CONFIRMED for sensor in kept):
                notes += ('selected, but not confirmed',)
            keep.append(Item(name, notes, rate))
        elif None not in found and all(sensor.status == DISPENSABLE for sensor in sensors):
            notes = _added(name, sensors, _at_most) + _conditions(sensors)
            if name in needed:
                notes += ('but actions, steps, the reward or the ends of episodes need the topic',)
                keep.append(Item(name, notes, rate))
            else:
                can_go.append(Item(name, notes, rate))
        else:
            more = _most([_more_episodes(s, selection) for s in found])
            open_ones = [sensor for sensor in sensors if sensor.status != DISPENSABLE]
            notes = _added(name, open_ones, _range, partial(_doubt, selection))
            undecided.append(Item(name, notes, rate, more))
    lists = tuple(keep), tuple(can_go), tuple(undecided)
    return Advice(_SCOPES[selection.target], *lists, _hints(selection))


def _hints(selection: Selection) -> tuple[str, ...]:
    if selection.episodes < FEWEST_EPISODES:
        episodes = counted(selection.episodes, 'episode')
        return (
            f'{episodes} are too few to call a sensor dispensable; expected at least '
            f'{FEWEST_EPISODES}, better 50.',
        )
    hints = []
    of_all, margin = selection.predicted_share_of_all, selection.margin
    can_go = any(sensor.status == DISPENSABLE for sensor in selection.sensors)
    if can_go and margin and of_all is not None and of_all < _LITTLE * margin:
        hints.append(
            f'All sensors together predict only {max(of_all, 0.0):.0%} of the '
            f'{PREDICTED[selection.target]}, so a sensor that adds less than {margin:.1%} may '
            'still matter. A smaller margin (margin, --margin) shows it, with more episodes.'
        )
    undecided = [sensor for sensor in selection.sensors if sensor.status == UNDECIDED]
    if selection.target == RETURN and len(undecided) > max(1, _FEW * len(selection.sensors)):
        hints.append(
            f'{len(undecided)} of {counted(len(selection.sensors), "sensor")} are undecided. Try '
            'target: decision, in the robot file or as --target decision. It looks one step ahead, '
            'which often needs fewer episodes; it needs the actions, if there are any.'
        )
    return tuple(hints)


def _added(
    name: str,
    sensors: Sequence[SensorResult],
    said: Callable[[Effect], str],
    remark: Callable[[SensorResult], str] = lambda sensor: '',
) -> tuple[str, ...]:
    """Return what sensors add, each with its name unless it is the item itself."""
    texts = {s.name: (said(s.effect) if s.effect is not None else '') + remark(s) for s in sensors}
    if list(texts) == [name]:
        return (texts[name].strip(),) if texts[name] else ()
    return (first([f'{short(s)} {text}'.rstrip() for s, text in texts.items()]) or 'not tested',)


def _doubt(selection: Selection, sensor: SensorResult) -> str:
    """Return why a sensor is undecided, in parentheses, unless its range says so."""
    because = undecided_because(selection, sensor)
    return '' if because in ('', FEW_EPISODES, WIDE_INTERVAL) else f' ({because})'


def _estimate(effect: Effect) -> str:
    return f'adds {share(effect.share)}'


def _at_most(effect: Effect) -> str:
    return f'adds at most {share(max(effect.upper_bound, 0.0))}'


def _range(effect: Effect) -> str:
    if effect.low <= 0:
        return f'may add up to {share(max(effect.high, 0.0))}'
    return f'adds {interval(effect)}'


def _conditions(sensors: Sequence[SensorResult]) -> tuple[str, ...]:
    """Return the conditions for switching sensors off."""
    found = []
    redundant = dict.fromkeys(name for sensor in sensors for name in sensor.redundant_with)
    if redundant:
        found.append(f'as long as {listed(list(redundant))} stays')
    if any(sensor.is_constant for sensor in sensors):
        found.append('never changed in these episodes')
    return tuple(found)


def _most(counts: Sequence[int | None]) -> int | None:
    known = [count for count in counts if count is not None]
    return max(known) if len(known) == len(counts) else None


def _more_episodes(sensor: SensorResult | None, selection: Selection) -> int | None:
    """Return how many more episodes would separate the effect of a sensor from 0 or the margin.

    This assumes that the estimate stays and its error falls with the root of the number of
    episodes. None if the error is small enough already, so that something else keeps the sensor
    undecided, or if very many would be needed.
    """
    if sensor is None:
        return None
    if sensor.status == DISPENSABLE:
        return 0
    effect, margin = sensor.effect, selection.margin
    if effect is None or margin is None:
        return None
    to_confirm = effect.share / -NormalDist().inv_cdf(_ALPHA / len(selection.sensors))
    to_dispense = (margin - effect.share) / -NormalDist().inv_cdf(_ALPHA)
    needed = max(to_confirm, to_dispense)  # One is positive, as the margin is.
    if not needed < effect.error <= _MAX_EXCESS * needed:
        return None
    more = selection.episodes * ((effect.error / needed) ** 2 - 1)
    return _rounded_up(max(more, FEWEST_EPISODES - selection.episodes))


def _rounded_up(number: float) -> int:
    """Round up to one significant digit, at least 10, because it is a rough estimate."""
    unit = 10 ** max(1, int(math.log10(max(number, 1.0))))
    return int(math.ceil(number / unit) * unit)


def advice_fields(advice: Advice) -> dict[str, Any]:
    """Return advice as a dict for JSON; docs/interface.md lists the fields."""
    items = [*advice.keep, *advice.can_go, *advice.undecided]
    return {
        'keep': [item.name for item in advice.keep],
        'can_go': [item.name for item in advice.can_go],
        'undecided': [
            {'name': item.name, 'more_episodes': item.more_episodes} for item in advice.undecided
        ],
        'rates': rate_fields({item.name: item.rate for item in items if item.rate is not None}),
    }


def advice_lines(advice: Advice, most: int | None = None) -> list[str]:
    """Return advice as lines of text: three headings, each with all items, or at most `most`."""
    lines = textwrap.wrap(advice.scope, LINE_WIDTH)
    for heading, items in headed(advice):
        lines.append(f'{heading}:' if items else f'{heading}: nothing')
        for item in items[:most]:
            lines += textwrap.wrap(
                text_of(item), LINE_WIDTH, initial_indent='  ', subsequent_indent='    ',
                break_long_words=False, break_on_hyphens=False,
            )  # fmt: skip
        if most is not None and len(items) > most:
            lines.append(f'  and {len(items) - most} more')
    return lines + [line for hint in advice.hints for line in textwrap.wrap(hint, LINE_WIDTH)]


def headed(advice: Advice) -> list[tuple[str, Sequence[Item]]]:
    """Return the three lists with their headings; nothing if there is no advice."""
    if advice == Advice():
        return []
    can_go = 'these can go'
    rates = [item.rate for item in advice.can_go if item.rate is not None]
    if len(rates) > 1:
        can_go += f' (together {rate_in_words(Rate(*map(sum, zip(*rates, strict=True))))})'
    return [
        ('keep these', advice.keep),
        (can_go, advice.can_go),
        ('undecided', advice.undecided),
    ]


def text_of(item: Item) -> str:
    """Return an item of the advice as text."""
    parts = [*item.notes]
    parts += [rate_in_words(item.rate)] if item.rate is not None else []
    if item.more_episodes is not None:
        parts.append(f'about {counted(item.more_episodes, "more episode")} would decide')
    return f'{item.name}: {"; ".join(parts)}' if parts else item.name
