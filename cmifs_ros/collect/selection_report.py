"""A selection in words, and as the reply of the service: from plain values alone."""

from __future__ import annotations

import dataclasses

from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted, first, listed, short

from .selection_fields import EVIDENCE

NOTHING_SELECTED = 'no evidence that any sensor tells about the return'


def reply_of(selection: Selection) -> dict:
    """Return the fields of a selection that its reader wants, without empty evidence."""
    reply = dataclasses.asdict(selection)
    del reply['means'], reply['spreads']
    return {key: value for key, value in reply.items() if value or key not in EVIDENCE}


def is_tentative(selection: Selection) -> bool:
    """Tell whether nothing is confirmed so far, though something may be yet."""
    return not selection.indices and 'tentative' in selection.statuses


def headline(selection: Selection) -> str:
    """Return the result in a few words."""
    if is_tentative(selection):
        pvalue, best = min(zip(selection.pvalues, selection.ranking, strict=True))
        return (
            f'nothing confirmed yet; {counted(selection.episodes, "episode")}, '
            f'best so far {listed([best])}, p = {pvalue:.2g}'
        )
    sizes = counted(selection.episodes, 'episode')
    if not selection.num_live:
        return f'no sensor changed in {sizes}: nothing can be selected'
    if not selection.indices:
        return (
            f'{NOTHING_SELECTED}; {sizes}, and more may show it if the reward is what the task pays'
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
    numbers = selection.pvalues or selection.scores
    what, form = ('p ', '.2g') if selection.pvalues else ('', '.3f')
    statuses = selection.statuses or ('',) * len(selection.ranking)
    shown, rejected = [], []
    for name, number, status in zip(selection.ranking, numbers, statuses, strict=True):
        if status == 'rejected':
            rejected.append(name)
        else:
            shown.append(f'{short(name)} ({what}{number:{form}})')
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
    pairs = zip(selection.ranking, selection.redundant_with, strict=False)
    return first([f'{short(s)} with {" and ".join(map(short, of))}' for s, of in pairs if of])


def is_news(selection: Selection, previous: Selection | None) -> bool:
    """Tell whether a selection says something else than the one before."""
    if previous is None:
        return True
    return (set(selection.names), is_tentative(selection)) != (
        set(previous.names),
        is_tentative(previous),
    )
