# SPDX-License-Identifier: Apache-2.0

"""The fields of a topic's messages that could be channels, with the values observed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from cmifs_ros.core.words import first

from .field_path import (
    KEYS,
    MAX_PARTS,
    FieldPath,
    MissingFieldError,
    names_beside,
    parse_field_path,
)
from .model import Source
from .own_topics import Trace, is_own_entry

#: Values taken of a longer array, evenly spaced; messages taken of an array without names, the
#: first ones.
MAX_SLICE, MAX_INDEXED = 12, 4
#: Fields of a topic.
MAX_FIELDS = 200
#: A text, or an integer with up to this many values, may be a category.
FEWEST_CATEGORIES, MOST_CATEGORIES = 3, 8
_QUATERNION = 'geometry_msgs/msg/Quaternion'
#: Messages without measurements.
_SKIPPED = (
    'builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration', 'std_msgs/msg/Header',
    'sensor_msgs/msg/PointField',
)  # fmt: skip
#: An array of these is an image or other binary data.
BYTES = ('uint8', 'byte', 'octet')
#: Fields whose infinite values another field of the message replaces.
_INF = {'ranges': 'range_max', 'range': 'max_range'}
_IN_BRACES = re.compile(r'[^{},\s"\\]+')
_KEY = re.compile(r'[^{},"\\\x00-\x1f]+')
#: A text that `one_hot` accepts.
_WORD = re.compile(r'[A-Za-z_][\w -]{0,39}')


class TypeField(NamedTuple):
    """A field of a message type: its name and what it is.

    `kind` is 'number', 'numbers' (an array), 'text', the name of a message type, or that name with
    '[]' for an array of messages; anything else has no numbers.
    """

    name: str
    what: str


class ObservedField:
    """A field of a topic's messages, and the values observed so far.

    Attributes
    ----------
    path : FieldPath
    text : str
        The path as a robot file writes it.
    options : str
        Options that it needs in the file.
    num_seen : int
        Number of messages that had it.

    """

    def __init__(self, path: FieldPath, text: str, what: str = 'number', inf: str | None = None):
        is_yaw = what == _QUATERNION
        self.path, self.text = path, text
        self.options = ', as: yaw' if is_yaw else f', inf: {inf}' if inf else ''
        self.num_seen = 0
        self._source = Source('', path, is_yaw, inf=inf)
        self._newest: list[float] = []
        self._first = [math.nan] * len(self._source.names)
        self._is_changed = False
        self._categories: set[int] | None = set()
        self._words: dict[str, None] = {}

    @property
    def is_open(self) -> bool:
        """Whether another message could add information."""
        return not self._is_changed or self._categories is not None or self._is_unknown

    @property
    def _is_unknown(self) -> bool:
        return any(map(math.isnan, self._first))

    def look(self, message) -> None:
        """Observe the values of a message."""
        try:
            self._newest = self._source.readings(message)
        except MissingFieldError:  # a shorter array, or a joint missing from this message
            self._look_at_text(message)
            return
        if not self._newest:
            return
        self.num_seen += 1
        for i, value in enumerate(self._newest):
            if math.isfinite(value):
                if self._is_unknown and math.isnan(self._first[i]):
                    self._first[i] = value
                self._is_changed |= value != self._first[i]
        if self._categories is not None:
            raw = self._raw(message)
            is_whole = isinstance(raw, (int, bytes)) and not isinstance(raw, bool)
            found = self._categories | {int(self._newest[0])} if is_whole else None
            self._categories = found if found and len(found) <= MOST_CATEGORIES else None

    def _raw(self, message) -> object:
        found = self.path.values_in(message)
        return found[0] if len(found) == 1 else None

    def _look_at_text(self, message) -> None:
        try:
            value = self._raw(message)
        except MissingFieldError:
            return
        if isinstance(value, str):
            self.num_seen += 1
            if len(self._words) <= MOST_CATEGORIES:
                self._words[value[:41]] = None

    @property
    def is_text(self) -> bool:
        """Whether a value was not a number."""
        return bool(self._words)

    @property
    def words(self) -> list[str]:
        """The texts observed, if they may be categories; otherwise empty."""
        words = list(self._words)
        is_few = 2 <= len(words) <= MOST_CATEGORIES
        return words if is_few and all(map(_WORD.fullmatch, words)) else []

    @property
    def shown_words(self) -> str:
        """The texts observed, for display."""
        return first([repr(word) for word in self._words])

    @property
    def why_not(self) -> str:
        """Why it is not proposed as a channel; empty if it is."""
        never = [
            (name, new)
            for name, value, new in zip(self._source.names, self._first, self._newest, strict=False)
            if math.isnan(value)
        ]
        if never:
            return f'always {", ".join(sorted({_shown(new) for _, new in never}))} here' + (
                f': {first([name for name, _ in never])}' if len(self._first) > 1 else ''
            )
        if not self._is_changed:
            return f'never changed: {first(list(dict.fromkeys(map(_shown, self._first))))}'
        return ''

    @property
    def categories(self) -> str:
        """The values of an integer, if they are few; otherwise empty."""
        if self._categories is None or len(self._categories) < FEWEST_CATEGORIES:
            return ''
        return ', '.join(map(str, sorted(self._categories)))


def _shown(value: float) -> str:
    return 'NaN' if math.isnan(value) else f'{value:.6g}'


class ObservedTopic:
    """A topic and its observed fields.

    Parameters
    ----------
    topic : str
    kind : str
        The name of its type.
    fields_of : callable
        Returns the fields (`TypeField`) of a message type, in order.
    count : int, optional
        Number of messages.

    Attributes
    ----------
    count : int
    num_unseen : int
        Messages that could have added information but were not read.
    problem : str
        Why none was read, if none was.
    fields : dict of str to ObservedField, or None
        By path; None before the first message.
    has_entries : bool
        Whether some fields are arrays of messages, whose entries may differ between messages.
    trace : Trace
        Evidence that the topic belongs to this package.

    """

    def __init__(self, topic: str, kind: str, fields_of: Callable, count: int = 0):
        self.topic, self.kind, self.count = topic, kind, count
        self.num_unseen = 0
        self.problem = ' has no messages'
        self.fields: dict[str, ObservedField] | None = None
        self.has_entries = False
        self.trace = Trace(topic, kind)
        self._num_looks = 0
        self._open: list[ObservedField] = []
        self._fields_of = fields_of

    @property
    def is_open(self) -> bool:
        """Whether another message could add information."""
        return self.fields is None or bool(self._open) or self.has_entries or self.trace.is_open

    def look(self, message) -> None:
        """Observe the values of a message."""
        self._num_looks += 1
        self.trace.look(message)
        if self.fields is None or self.has_entries:
            self.fields = self.fields or {}
            for field in self._found(self.kind, message, self.topic, ()):
                if len(self.fields) == MAX_FIELDS:
                    break
                if field.text not in self.fields:
                    self.fields[field.text] = field
                    self._open.append(field)
        for field in self._open:
            field.look(message)
        if not self.has_entries:
            self._open = [field for field in self._open if field.is_open]

    def period(self, field: ObservedField, seconds: float) -> float:
        """Return the period of a field in seconds; `inf` if it came once."""
        share = field.num_seen / self._num_looks if self.has_entries else 1.0
        return seconds / (self.count * share) if self.count * share > 1 else math.inf

    def _found(self, kind: str, message, text: str, above: tuple) -> Iterator[ObservedField]:
        """Yield the fields of a message that have numbers or words, in its own order."""
        if len(above) >= MAX_PARTS:
            return
        for name, what in self._fields_of(kind):
            value = getattr(message, name, None)
            if value is None or not what or name == 'structure_needs_at_least_one_member':
                continue
            inner = f'{text}.{name}'
            if what.endswith('[]'):
                for end, entry in self._entries(value, (*above, message)):
                    if not is_own_entry(entry):
                        yield from self._found(what[:-2], entry, inner + end, (*above, message))
            elif what in ('number', 'numbers', 'text', _QUATERNION):
                end = _end(name, value, (*above, message)) if what == 'numbers' else ''
                try:
                    path = parse_field_path(inner + end)
                except ValueError:  # A robot file cannot name it.
                    continue
                inf = _INF.get(name) if not above else None
                has_inf = inf is not None and hasattr(message, inf)
                if what != 'numbers' or end:
                    yield ObservedField(path, inner + end, what, inf if has_inf else None)
            elif what not in _SKIPPED:
                yield from self._found(what, value, inner, (*above, message))

    def _entries(self, entries: Sequence, above: tuple) -> Iterator[tuple[str, object]]:
        """Yield a selector for each message of an array, by name or position, and the message."""
        if len(entries) == 0:
            self.has_entries = True
            return
        key = next((key for key in KEYS if getattr(entries[0], key, None)), None)
        names = [getattr(e, key) for e in entries] if key else names_beside(entries, above)
        if names is None:
            yield from ((f'[{place}]', entry) for place, entry in enumerate(entries[:MAX_INDEXED]))
            return
        self.has_entries = True
        for name, entry in zip(names, entries, strict=True):
            if isinstance(name, str) and _KEY.fullmatch(name):
                yield f'{{{name}}}', entry


def _end(name: str, values: Sequence, above: tuple) -> str:
    """Return a selector for values of an array: by name, the diagonal, or evenly spaced."""
    length = len(values)
    if length == 0:
        return ''
    names = names_beside(values, above) or []
    if names and len(set(names)) == length and all(map(_IN_BRACES.fullmatch, names)):
        return f'{{{",".join(names)}}}'
    if 'covariance' in name and math.isqrt(length) ** 2 == length and length > 1:
        return f'[0:{length}:{math.isqrt(length) + 1}]'
    stride = -(-length // MAX_SLICE)
    return f'[0:{length}:{stride}]' if stride > 1 else f'[0:{length}]'
