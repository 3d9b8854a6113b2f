# SPDX-License-Identifier: Apache-2.0

"""Paths to numbers in messages: `/topic.field.sub`, `[0:360:30]`, `{name,name}`.

Inside a path, `.status{left motor}.level` selects a message of an array by its name, and
`.poses[0].position` by its position.

It works on any object with the attributes of the message, those of rclpy and of rosbags.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from cmifs_ros.core.channel_names import MAX_CHANNELS, MAX_NAME_LENGTH
from cmifs_ros.core.words import counted, did_you_mean, listed

MAX_PARTS = 16
_MAX_INDEX = 10**7
#: The middleware refuses longer topics.
_MAX_TOPIC = 200

_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*')
_FIELD = re.compile(r'\.([A-Za-z][A-Za-z0-9_]*)((?:\{[^{}]+\}|\[\d+\])(?=\.))?')
_END = re.compile(r'(?:\[(\d+)\]|\[(\d*):(\d+)(?::(\d+))?\]|\{([^{}]+)\})?')


#: Fields that may name a message in an array.
KEYS = ('name', 'key', 'child_frame_id')


class MissingFieldError(Exception):
    """A message lacks what a path names, or has another type of value there."""


@dataclass(frozen=True)
class FieldPath:
    """A parsed path.

    Attributes
    ----------
    topic : str
    fields : tuple of str
        Empty for the message itself; `{text}` selects an entry of an array by name, `[3]` by
        position.
    indices : tuple of int
        Indices into an array, in order.
    names : tuple of str
        Names of entries of an array, which an array of names next to it gives.

    """

    topic: str
    fields: tuple[str, ...] = ()
    indices: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    is_list: bool = False

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes that distinguish its values: `[0]`, `.shoulder`; one empty text if single."""
        if len(self.names) > 1:
            return tuple(f'.{name}' for name in self.names)
        if self.is_list:
            return tuple(f'[{index}]' for index in self.indices)
        return ('',)

    @property
    def selects(self) -> bool:
        """Whether it selects entries that a message of other things lacks, such as other joints."""
        return bool(self.names) or any(field[0] in '{[' for field in self.fields)

    def __str__(self) -> str:
        """Return the path without its last field."""
        parts = (part if part[0] in '{[' else f'.{part}' for part in self.fields)
        return self.topic + ''.join(parts)

    def numbers_in(self, message) -> list[float]:
        """Return the values in a message as numbers; see `values_in`."""
        return [self.as_number(value) for value in self.values_in(message)]

    def as_number(self, value) -> float:
        """Return a value of a message as a number.

        A `byte` is b'3' in rclpy and 3 in rosbags; numeric text counts as a number.

        Raises
        ------
        MissingFieldError
            If it is not a number.

        """
        if isinstance(value, bytes):
            value = value[0]
        if isinstance(value, str) or not hasattr(value, '__len__'):  # NumPy accepts `[3]` as 3.
            try:
                return float(value)
            except (TypeError, ValueError):
                pass
        raise MissingFieldError(f'{self} is {described(value)}; expected {_remedy(value)}')

    def values_in(self, message) -> list:
        """Return the values in a message, as many as `suffixes`.

        They are none if an array has no entry called so, or a table's cell is empty: the message is
        of other things.

        Raises
        ------
        MissingFieldError
            If the message lacks a field, an index or a name, or has no array where one is needed.

        """
        value = message
        above: list = []
        for depth, field in enumerate(self.fields):
            if field[0] in '{[':
                FieldPath(self.topic, self.fields[:depth])._expect_array(value, field)
                if field[0] == '[':
                    (value,) = self._at(value, (int(field[1:-1]),))
                    continue
                value = _called(field[1:-1], value, above)
                if value is None:
                    return []
                continue
            above.append(value)
            value = getattr(value, field, None)
            if value is None:
                if hasattr(above[-1], field):  # An empty cell of a table says nothing.
                    return []
                own = _fields(above[-1])
                expected = f'; expected one of {own}' if own else ''
                meant = did_you_mean(field, _field_names(above[-1]))
                raise MissingFieldError(f'{self.topic} has no field {field!r}{meant}{expected}')
        if self.names:
            self._expect_array(value, f'{{{",".join(self.names)}}}')
            order = names_beside(value, above)
            if order is None:
                names = counted(len(getattr(above[-1], 'name', ())), 'name')
                raise MissingFieldError(
                    f'{self.topic} has {counted(len(value), "value")} for {names}'
                )
            missing = [name for name in self.names if name not in order]
            if missing:
                raise MissingFieldError(
                    f'{self.topic} has no {missing[0]!r} in its names'
                    f'{did_you_mean(missing[0], order)}'
                )
            return [value[order.index(name)] for name in self.names]
        if self.indices:
            self._expect_array(value, f'[{self.indices[0]}]')
            return self._at(value, self.indices)
        return [value]

    def _at(self, values, indices: Sequence[int]) -> list:
        if len(values) <= max(indices):
            raise MissingFieldError(
                f'{self.topic} has {counted(len(values), "value")}; '
                f'expected more than {max(indices)}'
            )
        return [values[index] for index in indices]

    def _expect_array(self, value, end: str) -> None:
        if isinstance(value, str) or not hasattr(value, '__len__'):
            raise MissingFieldError(f'{self} is {described(value)}; expected an array for {end}')


def names_beside(values, above: Sequence) -> list[str] | None:
    """Return the array of texts that names the entries of another, such as JointState's `name`.

    Parameters
    ----------
    values : sequence
        An array of a message.
    above : sequence
        The messages that contain it, innermost last: `joint_names` may be next to one of these.

    """
    for message in reversed(above):
        if len(own := getattr(message, 'name', ())) == len(values) and not isinstance(own, str):
            return list(own)
        for field in _field_names(message):
            names = getattr(message, field)
            if field.endswith(('names', 'groups')) and len(names) == len(values) > 0:
                return list(names)
    return None


def _called(text: str, entries: Sequence, above: Sequence):
    """Return the message with a name in an array, or None."""
    keys = [key for key in KEYS if any(hasattr(entry, key) for entry in entries[:1])]
    for entry in entries:
        for key in keys:
            if getattr(entry, key) == text:
                return entry
    names = names_beside(entries, above)
    return entries[names.index(text)] if names and text in names else None


def described(value) -> str:
    """Describe what was found instead of a number: a text, an array, a message."""
    if isinstance(value, str):
        return f'the text {value[:40]!r}'
    if hasattr(value, '__len__'):
        return f'an array of {counted(len(value), "value")}'
    if isinstance(value, (int, float)):
        return 'a number'
    name = type(value).__name__.rsplit('__')[-1]  # rosbags: geometry_msgs__msg__Pose
    return f'a {name} of {_fields(value)}'


def _remedy(value) -> str:
    if isinstance(value, str):
        return (
            'a number; if it is one of a few words, use `one_hot: [word, word]` in a channel, or '
            f'compare a value in reward and episode: status == {value[:20] or "done"!r}'
        )
    if hasattr(value, '__len__'):
        return f'[0] for one entry, [0:{len(value)}] for all, or {{name}} of a JointState'
    return 'a number: name a field of it'


def _fields(message) -> str:
    """Return the names of a message's fields as text, without constants, which are in capitals."""
    return listed(_field_names(message))


def _field_names(message) -> list[str]:
    names = [name for name in dir(message) if name == name.lower() and not name.startswith('_')]
    return [name for name in names if not callable(getattr(message, name))]


def parse_field_path(text: str) -> FieldPath:
    """Parse a path.

    Raises
    ------
    ValueError
        If it is malformed or too long, or its slice is too long or has no fixed end.

    """
    shown = repr(text if len(text) <= 60 else f'{text[:57]}...')
    if len(text) > 16 * MAX_NAME_LENGTH:
        raise ValueError(
            f'a path of {len(text)} characters; expected at most {16 * MAX_NAME_LENGTH}'
        )
    topic = _TOPIC.match(text)
    if topic is None:
        raise ValueError(f'{shown} is not a path; expected one such as /odom.pose.pose.position.x')
    if topic.end() > _MAX_TOPIC:
        raise ValueError(
            f'{shown} has a topic of {topic.end()} characters; expected at most {_MAX_TOPIC}'
        )
    position = topic.end()
    fields: list[str] = []
    while (field := _FIELD.match(text, position)) is not None:
        fields += filter(None, field.groups())
        position = field.end()
    if len(fields) > MAX_PARTS:
        raise ValueError(f'{shown} has {len(fields)} parts; expected at most {MAX_PARTS}')
    end = _END.fullmatch(text, position)
    if end is None:
        raise ValueError(
            f'{shown} is not valid from {text[position : position + 20]!r} on; expected '
            '[3], [0:360:30] with a fixed end, {name,name}, or {name}.field'
        )
    index, start, stop, step, braces = end.groups()
    indices: range | tuple = ()
    if index is not None:
        indices = (_checked_index(index),)
    elif stop is not None:
        stride = _checked_index(step or '1')
        if stride == 0:
            raise ValueError(f'{shown} has a slice with step 0; expected at least 1')
        indices = range(_checked_index(start or '0'), _checked_index(stop), stride)
        if not 0 < len(indices) <= MAX_CHANNELS:
            raise ValueError(
                f'{shown} has a slice of {len(indices)} values; expected 1 to {MAX_CHANNELS}'
            )
    names = tuple(name.strip() for name in braces.split(',')) if braces else ()
    if not all(names) or len(set(names)) < len(names):
        raise ValueError(f'{shown} has an empty or a repeated name in its braces')
    return FieldPath(topic[0], tuple(fields), tuple(indices), names, stop is not None)


def _checked_index(text: str) -> int:
    if len(text) > 8 or int(text) > _MAX_INDEX:
        raise ValueError(f'the index {text[:20]}; expected at most {_MAX_INDEX}')
    return int(text)
