"""A selection in words."""

from __future__ import annotations

from cmifs_ros.core.selection import Selection
from cmifs_ros.core.statuses import REJECTED, TENTATIVE
from cmifs_ros.core.words import counted, first, listed, short

NOTHING_SELECTED = 'no evidence that any sensor is informative about the return'


def is_tentative(selection: Selection) -> bool:
    """Tell whether nothing is confirmed so far, though something may be yet."""
    return not selection.indices and any(s.status == TENTATIVE for s in selection.sensors)


def headline(selection: Selection) -> str:
    """Return the result in a few words."""
    sizes = counted(selection.episodes, 'episode')
    if is_tentative(selection):
        tested = [sensor for sensor in selection.sensors if sensor.status == TENTATIVE]
        best = min(tested, key=lambda sensor: sensor.pvalue)
        return (
            f'nothing confirmed yet; {sizes}, best so far {short(best.name)}, p = {best.pvalue:.2g}'
        )
    if not selection.changing:
        return f'no sensor changed in {sizes}: nothing can be selected'
    if not selection.indices:
        return (
            f'{NOTHING_SELECTED}; {sizes}, and more may show it if the reward is that of the task'
        )
    return f'selected {listed(selection.names)}'


def change(selection: Selection) -> str:
    """Return that the task has changed, of a selection that left out what is outdated."""
    return (
        f'the task has changed: the oldest {counted(selection.outdated, "episode")} no longer fit '
        f'the newest {selection.episodes}, and are forgotten'
    )


def evidence(selection: Selection) -> str:
    """Return what the result rests on: sizes, scores or p-values, and what was rejected."""
    shown, rejected = [], []
    for sensor in selection.sensors:
        if sensor.status == REJECTED:
            rejected.append(sensor.name)
        elif sensor.pvalue is not None:
            shown.append(f'{short(sensor.name)} (p {sensor.pvalue:.2g})')
        else:
            shown.append(f'{short(sensor.name)} ({sensor.score:.3f})')
    parts = [first(shown)] if shown else []
    parts += [f'rejected {listed(rejected)}'] if rejected else []
    redundant = redundancies(selection)
    parts += [f'redundant: {redundant}'] if redundant else []
    parts.append(
        f'{counted(selection.episodes, "episode")}, {counted(selection.steps, "step")}, '
        f'{selection.seconds:.1f} s'
    )
    return '; '.join(parts)


def redundancies(selection: Selection) -> str:
    """Return which sensors are redundant, as 'copy with x'; empty if none."""
    redundant = [sensor for sensor in selection.sensors if sensor.redundant_with]
    return first(
        [f'{short(s.name)} with {" and ".join(map(short, s.redundant_with))}' for s in redundant]
    )


def is_news(selection: Selection, previous: Selection | None) -> bool:
    """Tell whether a selection says something else than the one before."""
    if previous is None:
        return True
    return (set(selection.names), is_tentative(selection)) != (
        set(previous.names),
        is_tentative(previous),
    )
