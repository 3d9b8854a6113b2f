# SPDX-License-Identifier: Apache-2.0

"""The view of `watch`: lines of text from diagnostics and the selection."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rich.console import Console, Group
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from cmifs_ros.collect.advice import Advice, advice_lines
from cmifs_ros.collect.selection_report import (
    is_confirmed_earlier,
    level_needed,
    prediction,
    reason,
    redundancies,
    undecided_because,
)
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.statuses import CONFIRMED, DISPENSABLE, UNDECIDED
from cmifs_ros.core.words import counted, first, short

from .ranking import Column, columns_of

#: Word and style by level of diagnostic_msgs/DiagnosticStatus; the word works without colour.
LEVELS = (('ok', 'green'), ('warn', 'yellow'), ('error', 'bold red'), ('stale', 'magenta'))
_STATUS_STYLES = {CONFIRMED: 'green', UNDECIDED: 'yellow', DISPENSABLE: 'dim'}
#: Seconds without diagnostics, which come once a second, until the selector counts as stopped.
GONE_AFTER = 5.0
_NAME_WIDTH = 24
#: Most sensors shown; lines of the ranking besides those of its sensors.
_MAX_SENSORS, _LINES_BESIDE = 40, 4
#: Statuses of the sampler that are not of topics.
_STEPS, _SAVING = 'steps', 'saving'
_MAX_BAD_TOPICS, _MAX_TOPICS = 4, 12
_MAX_REASON = 200


class Status(NamedTuple):
    """One status of the diagnostics: its level (0 to 3), message, and values by key."""

    level: int
    message: str
    values: Mapping[str, str]


@dataclass
class Snapshot:
    """What is known about a selector.

    Attributes
    ----------
    selector : str
        Its name with the namespace; empty before it is heard.
    statuses : dict of str to Status
        Statuses by subject: input, selection, storage.
    selection : Selection or None
        The one in use.
    unreadable : str
        Why the newest published selection cannot be read; empty if it can.
    advice : Advice or None
        Advice by topic; None if no sampler publishes the topics of the channels.
    sampler : dict of str to Status
        Statuses of the sampler, if there is one: of the steps and of each topic.
    silence, sampler_silence : float
        Seconds since the last diagnostics of the selector, and of the sampler.
    elsewhere : sequence of str
        Namespaces of other selectors.

    """

    selector: str = ''
    statuses: dict[str, Status] = field(default_factory=dict)
    selection: Selection | None = None
    unreadable: str = ''
    advice: Advice | None = None
    sampler: dict[str, Status] = field(default_factory=dict)
    silence: float = 0.0
    sampler_silence: float = 0.0
    elsewhere: Sequence[str] = ()

    @property
    def is_complete(self) -> bool:
        """Whether everything that the selector publishes has arrived."""
        selection = self.statuses.get('selection')
        return selection is not None and (
            'names' not in selection.values or self.selection is not None
        )

    @property
    def dropped(self) -> dict[str, str]:
        """The numbers of messages and episodes that the selector dropped, by cause."""
        values = self.statuses['input'].values if 'input' in self.statuses else {}
        return {key: n for key, n in values.items() if 'dropped' in key and n != '0'}


def view(snapshot: Snapshot, console: Console, max_lines: float = math.inf) -> Group:
    """Return the whole view for 80 columns; the ranking and the advice are cut to fit."""
    parts = [Rule(_plain(f'/{snapshot.selector}' if snapshot.selector else 'watch'), align='left')]
    if not snapshot.selector:
        parts += _nothing_heard(snapshot.elsewhere)
    elif snapshot.silence > GONE_AFTER:
        parts.append(
            Text(
                f'nothing heard for {snapshot.silence:.0f} s; below is the last view', LEVELS[2][1]
            )
        )
    warnings = snapshot.selection.warnings if snapshot.selection is not None else ()
    parts += [Text.assemble(('warning', LEVELS[1][1]), ' ', _plain(text)) for text in warnings]
    facts = Table.grid(padding=(0, 2))
    facts.add_column(style='bold')
    facts.add_column(overflow='fold')
    for i, line in enumerate(_sampler_lines(snapshot) if snapshot.sampler else ()):
        facts.add_row('' if i else 'sampler', line)
    for what, status in snapshot.statuses.items():
        facts.add_row(what, _headline(status))
        for line in _DETAILS.get(what, lambda snapshot: ())(snapshot):
            facts.add_row('', line)
    parts.append(facts)
    if snapshot.selection is None:
        return Group(*parts)

    def num_lines(*parts) -> int:
        return len(console.render_lines(Group(*parts)))

    room = max_lines - num_lines(*parts)
    num_sensors = min(_MAX_SENSORS, len(snapshot.selection.changing))
    for_advice = max(room / 2, room - num_sensors - _LINES_BESIDE)
    advice = Group()
    for most in range(_MAX_TOPICS, 0, -1):
        advice = _advice(snapshot.advice, most)
        if num_lines(advice) <= for_advice:
            break
    max_sensors = max(1, min(num_sensors, room - num_lines(advice) - _LINES_BESIDE))
    return Group(*parts, Text(), *_ranking(snapshot.selection, max_sensors), advice)


def _advice(advice: Advice | None, most: int) -> Group:
    """Return the lists of the advice, each with at most `most` items."""
    lines = [] if advice is None else advice_lines(advice, most)
    return Group(*map(_plain, ['', *lines] if lines else []))


def _plain(text: str) -> Text:
    """Return text from the network without control characters or markup."""
    return Text(''.join(c if c.isprintable() else '?' for c in text))


def _short(name: str) -> str:
    """Shorten a long name in the middle: lidar rays differ at the end."""
    if len(name) <= _NAME_WIDTH:
        return name
    half = _NAME_WIDTH // 2
    return f'{name[: half - 1]}…{name[-half:]}'


def _nothing_heard(elsewhere: Sequence[str]):
    yield Text('no selector heard in this namespace yet')
    for namespace in elsewhere:
        yield _plain(f'one is in another: watch --namespace {namespace}')


def _headline(status: Status) -> Text:
    word, style = LEVELS[min(status.level, len(LEVELS) - 1)]
    return Text.assemble((word, style), ' ', _plain(status.message))


def _sampler_lines(snapshot: Snapshot):
    """Yield the steps, and the topics with problems; without a selector, all topics."""
    if snapshot.sampler_silence > GONE_AFTER:
        yield Text(f'nothing heard for {snapshot.sampler_silence:.0f} s', LEVELS[2][1])
        return
    if _STEPS in snapshot.sampler:
        steps = snapshot.sampler[_STEPS]
        yield _headline(steps)
        yield _plain(
            f'{counted(steps.values.get("steps", "?"), "step")}, '
            f'{steps.values.get("steps per s", "?")} per s'
        )
    if _SAVING in snapshot.sampler:
        yield from _saving_lines(snapshot.sampler[_SAVING])
    said_of = snapshot.sampler.items()
    topics = [(what, said) for what, said in said_of if what not in (_STEPS, _SAVING)]
    most = _MAX_TOPICS
    if snapshot.selector:
        topics, most = [(what, said) for what, said in topics if said.level > 0], _MAX_BAD_TOPICS
    topics.sort(key=lambda topic: -topic[1].level)
    for topic, said in topics[:most]:
        yield Text.assemble(_plain(topic), ' ', _headline(said))
    if len(topics) > most:
        yield Text(f'and {counted(len(topics) - most, "more topic")}')


def _saving_lines(saving: Status):
    yield Text.assemble('saving ', _headline(saving))
    values = saving.values
    if values.get('messages saved', '0') != '0':
        yield _plain(
            f'saved so far: {values["messages saved"]} messages, {values.get("bytes saved", "?")}'
        )
        for key, value in values.items():
            if key.startswith('saved: '):
                yield _plain(f'{key.removeprefix("saved: ")} {value.partition(";")[0]}')
    cpu = [f'{values[key]} {key[4:]}' for key in values if key.startswith('CPU ')]
    if cpu:
        yield _plain(f'CPU: {", ".join(cpu)}')


def _input_lines(snapshot: Snapshot):
    values = snapshot.statuses['input'].values
    yield _plain(
        f'{counted(values.get("episodes", "?"), "episode")}, '
        f'{counted(values.get("steps", "?"), "step")}; '
        f'{_megabytes(values, "buffer bytes")} of {_megabytes(values, "buffer bytes allowed")} MB'
    )
    yield from (_plain(f'{key}: {n}') for key, n in snapshot.dropped.items())


def _selection_lines(snapshot: Snapshot):
    values, selection = snapshot.statuses['selection'].values, snapshot.selection
    if 'names' in values:
        yield _plain(f'in use: {values["names"]}')
        yield _plain(
            f'made {_age(values.get("age in s", "?"))} ago ({values.get("cause", "?")}), from '
            f'{counted(values.get("episodes used", "?"), "episode")} '
            f'in {values.get("seconds taken", "?")} s'
        )
    if selection is not None:
        yield from map(_plain, _facts(selection))
    if snapshot.unreadable:
        yield _plain(f'the selection cannot be read: {snapshot.unreadable[:_MAX_REASON]}')
    worker = f'worker {values.get("worker", "?")}'
    if values.get('worker') == 'computing':
        worker += f' for {values.get("computing for s", "?")} s'
        worker += f', {values["progress"]} done' if 'progress' in values else ''
    yield _plain(worker)


def _facts(selection: Selection):
    """Yield the facts of a selection besides its ranking."""
    if predicted := prediction(selection):
        yield predicted
    reasons = [(sensor, reason(selection, sensor)) for sensor in selection.sensors]
    if why := first([f'{short(sensor.name)} ({text})' for sensor, text in reasons if text]):
        yield f'why: {why}'
    earlier = [short(s.name) for s in selection.sensors if is_confirmed_earlier(selection, s)]
    if earlier:
        yield f'confirmed by earlier selections: {first(earlier)}'
    because = [(sensor, undecided_because(selection, sensor)) for sensor in selection.sensors]
    if why := first([f'{short(sensor.name)} ({text})' for sensor, text in because if text]):
        yield f'undecided: {why}{level_needed(selection)}'
    if redundancies(selection):
        yield f'redundant: {redundancies(selection)}'


def _storage_lines(snapshot: Snapshot):
    values = snapshot.statuses['storage'].values
    yield _plain(f'{_megabytes(values, "file bytes")} MB in {values.get("path", "?")}')


_DETAILS = {'input': _input_lines, 'selection': _selection_lines, 'storage': _storage_lines}


def _megabytes(values: Mapping[str, str], key: str) -> str:
    try:
        return f'{float(values[key]) / 1e6:.1f}'
    except (KeyError, ValueError):
        return '?'


def _age(seconds: str) -> str:
    if not seconds.isdecimal():
        return '?'
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f'{hours} h {minutes} min' if hours else f'{minutes} min' if minutes else f'{seconds} s'


def _ranking(selection: Selection, max_sensors: int):
    columns = columns_of(selection)
    table = Table(box=None, pad_edge=False, header_style='bold')
    for heading, _, is_text in columns:
        table.add_column(heading, justify='left' if is_text else 'right', no_wrap=True)
    for row in list(zip(*(column.cells for column in columns), strict=True))[:max_sensors]:
        table.add_row(*(_cell(*cell) for cell in zip(columns, row, strict=True)))
    yield table
    num_shown = len(selection.changing)
    if num_shown > max_sensors:
        yield Text(f'and {num_shown - max_sensors} more')
    num_constant = len(selection.sensors) - num_shown
    if num_constant:
        yield Text(f'{counted(num_constant, "sensor")} constant')


def _cell(column: Column, value: str) -> Text:
    if column.heading == 'status':
        return Text(value, _STATUS_STYLES.get(value, ''))
    return _plain(_short(value) if column.heading == 'sensor' else value)
