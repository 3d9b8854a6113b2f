# SPDX-License-Identifier: Apache-2.0

"""A selection in words."""

from __future__ import annotations

import re
from collections.abc import Iterable

from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import Selection, SensorResult
from cmifs_ros.core.statuses import CONFIRMED, DISPENSABLE, FEWEST_EPISODES, UNDECIDED, USUAL_LEVEL
from cmifs_ros.core.targets import ACTION, DECISION, RETURN, REWARD
from cmifs_ros.core.words import counted, first, listed, short

#: What is predicted, by target; for a decision, the reward first of all.
PREDICTED = {RETURN: 'return', DECISION: 'reward', ACTION: 'action'}
#: Line width of printed text.
LINE_WIDTH = 80
#: Why a sensor is undecided, where nothing but the number of episodes is the reason.
FEW_EPISODES, BIASED, WIDE_INTERVAL = 'few episodes', 'biased episodes', 'wide interval'
_PREDICTS = 'predicts '


def is_undecided(selection: Selection) -> bool:
    """Return whether nothing is confirmed yet, but more episodes may confirm something."""
    return not selection.indices and any(s.status == UNDECIDED for s in selection.sensors)


def nothing_selected(selection: Selection) -> str:
    """Return the meaning of an empty selection."""
    return f'no evidence that any sensor is informative about the {PREDICTED[selection.target]}'


def headline(selection: Selection) -> str:
    """Return the result in a few words."""
    sizes = counted(selection.episodes, 'episode')
    if is_undecided(selection):
        tested = [sensor for sensor in selection.sensors if sensor.status == UNDECIDED]
        best = min(tested, key=lambda sensor: sensor.pvalue)
        return (
            f'nothing confirmed yet; {sizes}, best so far {short(best.name)}, p = {best.pvalue:.2g}'
            f'{level_needed(selection)}'
        )
    if not selection.changing:
        return f'no sensor changed in {sizes}: nothing can be selected'
    if not selection.indices:
        check = '' if selection.target == ACTION else '; check that the reward is that of the task'
        return f'{nothing_selected(selection)} in {sizes}{check}'
    return f'selected {listed(selection.selected)}'


def level_needed(selection: Selection) -> str:
    """Return which p-values confirm, to be appended; empty if unknown."""
    return '' if selection.level is None else f', needed: p <= {selection.level:.2g}'


def change(selection: Selection) -> str:
    """Return the message that the task has changed and how many episodes are outdated."""
    return (
        f'the task has changed: the oldest {counted(selection.outdated, "episode")} no longer fit '
        f'the newest {selection.episodes} and are forgotten'
    )


def evidence(selection: Selection) -> str:
    """Return the evidence for a selection: effects and p-values, or scores; and what is not."""
    selected: list[str] = []
    others: list[str] = []
    dispensable: list[str] = []
    for sensor in selection.sensors:
        name, shown = short(sensor.name), selected if sensor.is_selected else others
        if sensor.status == DISPENSABLE and not sensor.is_selected:
            dispensable.append(sensor.name)
        elif sensor.pvalue is None:
            shown.append(f'{name} ({sensor.score:.3f})')
        elif sensor.effect is None:
            shown.append(f'{name} (p {sensor.pvalue:.2g})')
        else:
            shown.append(f'{name} (adds {share(sensor.effect.share)}, p {sensor.pvalue:.2g})')
    parts = [first(selected)] if selected else []
    if others:
        needed = level_needed(selection) if selected else ''  # Else the headline says it.
        parts.append(f'not selected: {first(others)}{needed}')
    parts += [f'dispensable: {listed(dispensable)}'] if dispensable else []
    redundant = redundancies(selection)
    parts += [f'redundant: {redundant}'] if redundant else []
    parts.append(
        f'{counted(selection.episodes, "episode")}, {counted(selection.steps, "step")}, '
        f'{selection.seconds:.1f} s'
    )
    return '; '.join(parts)


def share(value: float) -> str:
    """Return a share as a percentage."""
    return f'{value:.1%}'.replace('-0.0%', '0.0%')


def interval(effect: Effect) -> str:
    """Return the 95 % confidence interval of an effect; a true share is not below 0."""
    high = share(max(effect.high, 0.0))
    return f'below {high}' if effect.low <= 0 else f'{share(effect.low)} to {high}'


def prediction(selection: Selection) -> str:
    """Return how much the selected sensors predict, and all sensors; empty if unknown.

    If half of that needs no sensor, because the return follows the step or the action, it says so.
    """
    if selection.predicted_share is None or selection.predicted_share_of_all is None:
        return ''
    # A prediction worse than the mean counts as 0.
    of_selected = max(selection.predicted_share, 0.0)
    of_all = max(selection.predicted_share_of_all, 0.0)
    of_none = max(selection.predicted_share_of_none or 0.0, 0.0)
    variance = f'of the variance of the {PREDICTED[selection.target]} in episodes left out'
    count, num_selected = len(selection.sensors), sum(s.is_selected for s in selection.sensors)
    if not num_selected:
        said = f'all sensors together predict {of_all:.0%} {variance}'
    elif num_selected == count:
        said = f'all sensors are selected, and predict {of_selected:.0%} {variance}'
    else:
        verb = 'predicts' if num_selected == 1 else 'predict'
        said = (
            f'the {num_selected} selected of {counted(count, "sensor")} {verb} {of_selected:.0%} '
            f'{variance}; all together, {of_all:.0%}'
        )
        if round(of_all, 2) < round(of_selected, 2):
            said += ' (the others make it harder to learn)'
    if round(of_none, 2) > 0 and of_none >= (of_selected if num_selected else of_all) / 2:
        context = 'step' if selection.target == ACTION else 'step and the action'
        said += f'; without any sensor, the {context} alone: {of_none:.0%}'
    return said


def reason(selection: Selection, sensor: SensorResult) -> str:
    """Return what a sensor is needed for, such as 'predicts y -> x -> reward'; may be empty.

    It applies to selected or confirmed sensors, if the target has several variables. A chain that
    does not reach the reward, because two sensors predict each other, ends at its first link.
    """
    if selection.target == RETURN or not (sensor.is_selected or sensor.status == CONFIRMED):
        return ''
    if not sensor.why.startswith(_PREDICTS):
        return sensor.why
    sensors = {s.name: s for s in selection.sensors}
    links, seen = [sensor.why.removeprefix(_PREDICTS)], {sensor.name}
    while (name := predicted_by(selection, sensor)) in sensors.keys() - seen:
        sensor = sensors[name]
        seen.add(name)
        if sensor.why == REWARD:
            return _PREDICTS + ' -> '.join([*links, REWARD])
        links.append(sensor.why.removeprefix(_PREDICTS))
    return _PREDICTS + links[0]


def is_confirmed_earlier(selection: Selection, sensor: SensorResult) -> bool:
    """Return whether a running selector keeps what only earlier selections confirmed."""
    return (
        sensor.status == CONFIRMED
        and selection.level is not None
        and sensor.pvalue > selection.level
    )


def undecided_because(selection: Selection, sensor: SensorResult) -> str:
    """Return why a sensor is undecided; empty if it is not."""
    if sensor.status != UNDECIDED:
        return ''
    if selection.episodes < FEWEST_EPISODES:
        return FEW_EPISODES
    if selection.losses:
        return BIASED
    if selection.level is not None and selection.level < sensor.pvalue <= USUAL_LEVEL:
        return f'p above {selection.level:.2g}'
    if sensor.together_with:
        others = len(sensor.together_with) - 1
        more = f' and {others} more' if others else ''
        return f'may matter with {short(sensor.together_with[0])}{more}'
    return WIDE_INTERVAL


def predicted_by(selection: Selection, sensor: SensorResult) -> str | None:
    """Return the sensor whose next value a sensor predicts; None if it is the reward."""
    if sensor.why == REWARD:
        return None
    channel = sensor.why.removeprefix(_PREDICTS)
    return next((s.name for s in selection.sensors if channel in s.channels), channel)


def redundancies(selection: Selection) -> str:
    """Return the redundant sensors, such as 'copy with x'; empty if there are none."""
    redundant = [sensor for sensor in selection.sensors if sensor.redundant_with]
    return first(
        [f'{short(s.name)} with {" and ".join(map(short, s.redundant_with))}' for s in redundant]
    )


def kinds_of_warnings(warnings: Iterable[str]) -> dict[str, str]:
    """Return warnings by kind: their text without the numbers, which keep changing."""
    return {re.sub(r'\S*\d\S*', '#', warning): warning for warning in warnings}


def is_news(selection: Selection, previous: Selection | None) -> bool:
    """Return whether a selection differs from the previous one."""
    if previous is None:
        return True
    return (set(selection.names), is_undecided(selection)) != (
        set(previous.names),
        is_undecided(previous),
    )
