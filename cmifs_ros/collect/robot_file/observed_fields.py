# SPDX-License-Identifier: Apache-2.0

"""The fields of a topic's messages that could be channels, with the values observed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from cmifs_ros.collect.encoders import Cloud, Encoder, Image, Scan, Yaw

from .field_path import (
    KEYS,
    MAX_PARTS,
    names_beside,
    parse_field_path,
)
from .observed_field import ObservedField
from .own_topics import Trace, is_own_entry

#: Values taken of a longer array, evenly spaced; messages taken of an array without names, the
#: first ones.
MAX_SLICE, MAX_INDEXED = 12, 4
#: About how many messages of a topic are read.
MAX_LOOKS = 1000
#: Fields of a topic.
MAX_FIELDS = 200
_QUATERNION = 'geometry_msgs/msg/Quaternion'
#: Messages that are one sensor as a whole.
_WHOLE: dict[str, Encoder] = {
    'sensor_msgs/msg/Image': Image(),
    'sensor_msgs/msg/CompressedImage': Image(),
    'sensor_msgs/msg/PointCloud2': Cloud(),
    'sensor_msgs/msg/LaserScan': Scan(),  # Nearly every scan has some ray without a reading.
}
#: Messages without measurements.
_SKIPPED = (
    'builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration', 'std_msgs/msg/Header',
    'sensor_msgs/msg/PointField',
)  # fmt: skip
#: An array of these is an image or other binary data.
BYTES = ('uint8', 'byte', 'octet')
#: Fields whose infinite values another field of the message replaces.
_INF = {'range': 'max_range'}
_IN_BRACES = re.compile(r'[^{},\s"\\]+')
_KEY = re.compile(r'[^{},"\\\x00-\x1f]+')


class TypeField(NamedTuple):
    """A field of a message type: its name and what it is.

    `what` is 'number', 'numbers' (an array), 'text', the name of a message type, or that name with
    '[]' for an array of messages; anything else has no numbers.
    """

    name: str
    what: str


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
    seconds : float, optional
        Duration in which they came.

    Attributes
    ----------
    count, seconds : see above
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

    def __init__(
        self, topic: str, kind: str, fields_of: Callable, count: int = 0, seconds: float = 0.0
    ):
        self.topic, self.kind = topic, kind
        self.count, self.seconds = count, seconds
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
        is_known = self.fields is not None and not self._open and not self.trace.is_open
        return not is_known or self.has_entries

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

    @property
    def rate(self) -> float:
        """Messages per second; 0 if there was only one, or all came at once."""
        return self.count / self.seconds if self.count > 1 and self.seconds > 0 else 0.0

    def period(self, field: ObservedField) -> float:
        """Return the period of a field in seconds; `inf` if it came once."""
        share = field.num_seen / self._num_looks if self.has_entries else 1.0
        return self.seconds / (self.count * share) if self.count * share > 1 else math.inf

    def _found(self, kind: str, message, text: str, above: tuple) -> Iterator[ObservedField]:
        """Yield the fields of a message that have numbers or words, in its own order."""
        if len(above) >= MAX_PARTS:
            return
        if kind in _WHOLE:
            yield ObservedField(parse_field_path(text), text, _WHOLE[kind])
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
                    encoder = Yaw() if what == _QUATERNION else None
                    yield ObservedField(path, inner + end, encoder, inf if has_inf else None)
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
