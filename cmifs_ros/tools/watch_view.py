"""What `watch` shows: from the plain values of diagnostics and scores to lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rich.console import Group
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from cmifs_ros.core.words import counted

#: By level of diagnostic_msgs/DiagnosticStatus: word and style. The word tells without colour.
LEVELS = (('ok', 'green'), ('warn', 'yellow'), ('error', 'bold red'), ('stale', 'magenta'))
_STATUS_STYLES = {'confirmed': 'green', 'tentative': 'yellow', 'rejected': 'dim'}
#: Seconds without diagnostics, which come once a second, after which the selector seems gone.
GONE_AFTER = 5.0
_BAR_WIDTH = 16
_NAME_WIDTH = 24
#: What the sampler says of its steps, beside what it says of each topic.
_STEPS = 'steps'
_MAX_BAD_TOPICS = 4


class Status(NamedTuple):
    """One status of the diagnostics: its level from 0 to 3, message, and values by key."""

    level: int
    message: str
    values: Mapping[str, str]


@dataclass
class Snapshot:
    """What is known of one selector.

    Attributes
    ----------
    selector : str
        Its name with the namespace; empty until it was heard of.
    statuses : dict of str to Status
        By what they are of: input, selection, storage.
    ranking : sequence of str
    scores : sequence of float
        The criterion of the first 1, 2, ... sensors of the ranking.
    sampler : dict of str to Status
        Of the sampler, if there is one: of its steps, and by topic.
    silence, sampler_silence : float
        Seconds since the last diagnostics of the selector, and of the sampler.
    elsewhere : sequence of str
        Namespaces in which other selectors were heard.

    """

    selector: str = ''
    statuses: dict[str, Status] = field(default_factory=dict)
    ranking: Sequence[str] = ()
    scores: Sequence[float] = ()
    sampler: dict[str, Status] = field(default_factory=dict)
    silence: float = 0.0
    sampler_silence: float = 0.0
    elsewhere: Sequence[str] = ()

    @property
    def is_complete(self) -> bool:
        """Whether all has come that the selector has to say."""
        selection = self.statuses.get('selection')
        return selection is not None and ('names' not in selection.values or bool(self.ranking))


def view(snapshot: Snapshot, max_sensors: int = 40) -> Group:
    """Return the whole view, readable at 80 columns; of a long ranking the first sensors."""
    if not snapshot.selector:
        return Group(Rule('watch', align='left'), *_nothing_heard(snapshot.elsewhere))
    parts = [Rule(_plain(f'/{snapshot.selector}'), align='left')]
    if snapshot.silence > GONE_AFTER:
        parts.append(
            Text(f'nothing heard for {snapshot.silence:.0f} s; below is the last', LEVELS[2][1])
        )
    facts = Table.grid(padding=(0, 2))
    facts.add_column(style='bold')
    facts.add_column(overflow='fold')
    sampler = list(_sampler_lines(snapshot)) if snapshot.sampler else []
    for i, line in enumerate(sampler):
        facts.add_row('' if i else 'sampler', line)
    for what, status in snapshot.statuses.items():
        facts.add_row(what, _headline(status))
        for line in _DETAILS.get(what, lambda values: ())(status.values):
            facts.add_row('', line)
    parts.append(facts)
    if snapshot.ranking:
        parts += [Text(), *_ranking(snapshot, max(1, max_sensors - len(sampler)))]
    return Group(*parts)


def _plain(text: str) -> Text:
    """Return text from outside, which must neither style nor steer the terminal."""
    return Text(''.join(c if c.isprintable() else '?' for c in text))


def _short(name: str) -> str:
    """Return the two ends of a long name: lidar rays differ in the last."""
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
    if snapshot.sampler_silence > GONE_AFTER:
        yield Text(f'nothing heard for {snapshot.sampler_silence:.0f} s', LEVELS[2][1])
        return
    if _STEPS in snapshot.sampler:
        yield _headline(snapshot.sampler[_STEPS])
    bad = [(w, s) for w, s in snapshot.sampler.items() if s.level > 0 and w != _STEPS]
    for topic, status in bad[:_MAX_BAD_TOPICS]:
        yield Text.assemble(_plain(topic), ' ', _headline(status))
    if len(bad) > _MAX_BAD_TOPICS:
        yield Text(f'and {counted(len(bad) - _MAX_BAD_TOPICS, "more topic")}')


def _input_lines(values: Mapping[str, str]):
    yield _plain(
        f'{counted(values.get("episodes", "?"), "episode")}, '
        f'{counted(values.get("steps", "?"), "step")}; '
        f'{_megabytes(values, "buffer bytes")} of {_megabytes(values, "buffer bytes allowed")} MB'
    )
    dropped = [f'{key}: {n}' for key, n in values.items() if 'dropped' in key and n != '0']
    yield from map(_plain, dropped)


def _selection_lines(values: Mapping[str, str]):
    if 'names' in values:
        yield _plain(f'in use: {values["names"]}')
        yield _plain(
            f'made {_age(values.get("age in s", "?"))} ago ({values.get("cause", "?")}), from '
            f'{counted(values.get("episodes used", "?"), "episode")} '
            f'in {values.get("seconds taken", "?")} s'
        )
    if 'stand-ins' in values:
        yield _plain(f'stand-ins: {values["stand-ins"]}')
    worker = f'worker {values.get("worker", "?")}'
    if values.get('worker') == 'computing':
        worker += f' for {values.get("computing for s", "?")} s'
        worker += f', {values["progress"]} done' if 'progress' in values else ''
    yield _plain(worker)


def _storage_lines(values: Mapping[str, str]):
    yield _plain(f'{_megabytes(values, "file bytes")} MB in {values.get("path", "?")}')


_DETAILS = {'input': _input_lines, 'selection': _selection_lines, 'storage': _storage_lines}


def _megabytes(values: Mapping[str, str], key: str) -> str:
    try:
        return f'{float(values[key]) / 1e6:.1f}'
    except (KeyError, ValueError):
        return '?'


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else 0


def _age(seconds: str) -> str:
    if not seconds.isdecimal():
        return '?'
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f'{hours} h {minutes} min' if hours else f'{minutes} min' if minutes else f'{seconds} s'


def by_sensor(ranking: Sequence[str], listed: str) -> dict[str, str]:
    """Return the values of 'x confirmed, y tentative' by sensor; a name may hold ', ' itself."""
    found, begin = {}, 0
    for name in ranking:
        if not listed.startswith(f'{name} ', begin):
            break
        value, _, _ = listed[begin + len(name) + 1 :].partition(', ')
        found[name] = value
        begin += len(name) + 1 + len(value) + len(', ')
    return found


def _ranking(snapshot: Snapshot, max_sensors: int):
    values = snapshot.statuses['selection'].values if 'selection' in snapshot.statuses else {}
    statuses = by_sensor(snapshot.ranking, values.get('statuses', ''))
    pvalues = by_sensor(snapshot.ranking, values.get('pvalues', ''))
    num_live = len(snapshot.ranking) - _number(values.get('sensors that never changed', ''))
    scores = snapshot.scores[: max(0, num_live)]
    best = max([*scores, 0.0])
    table = Table(box=None, pad_edge=False, header_style='bold')
    table.add_column('', justify='right')
    table.add_column('sensor', no_wrap=True)
    table.add_column('score', justify='right', no_wrap=True)
    table.add_column('', width=_BAR_WIDTH)
    if pvalues:
        table.add_column('p', justify='right', no_wrap=True)
    if statuses:
        table.add_column('status', no_wrap=True)
    rows = zip(snapshot.ranking, scores, strict=False)
    for rank, (name, score) in enumerate(list(rows)[:max_sensors], start=1):
        share = max(0.0, score / best) if best > 0 else 0.0
        status = statuses.get(name, '')
        table.add_row(
            str(rank),
            _plain(_short(name)),
            f'{score:.3f}',
            Text('█' * round(_BAR_WIDTH * share), 'cyan'),
            *([_plain(pvalues.get(name, ''))] if pvalues else []),
            *([Text(status, _STATUS_STYLES.get(status, ''))] if statuses else []),
        )
    yield table
    left = num_live - max_sensors
    if left > 0:
        yield Text(f'and {left} more')
    if num_live < len(snapshot.ranking):
        yield Text(f'{counted(len(snapshot.ranking) - num_live, "sensor")} never changed')
