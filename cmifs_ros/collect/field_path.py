"""Where a number lies in a message: `/topic.field.sub`, `[0:360:30]`, `{name,name}`.

In the middle, `.status{left motor}.level` takes of an array of messages the one called so.

Works on any object with the message's attributes, rclpy's and rosbags' alike.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from .state_reader import MAX_CHANNELS, MAX_NAME_LENGTH
from .words import counted

MAX_PARTS = 16
_MAX_INDEX = 10**7
#: A longer topic is refused by the middleware.
_MAX_TOPIC = 200

_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*')
_FIELD = re.compile(r'\.([A-Za-z][A-Za-z0-9_]*)(\{[^{}]+\}(?=\.))?')
_END = re.compile(r'(?:\[(\d+)\]|\[(\d*):(\d+)(?::(\d+))?\]|\{([^{}]+)\})?')


class MissingFieldError(Exception):
    """A message has no such field, or an array of another length; the text says which."""


@dataclass(frozen=True)
class FieldPath:
    """A path that was checked.

    Attributes
    ----------
    topic : str
    fields : tuple of str
        None for the message itself; `{text}` is the entry whose `name` or `key` is the text.
    indices : tuple of int
        Of an array, in order.
    names : tuple of str
        Entries of an array that the message's `name` array orders.

    """

    topic: str
    fields: tuple[str, ...] = ()
    indices: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    is_list: bool = False

    @property
    def suffixes(self) -> tuple[str, ...]:
        """What distinguishes its values: `[0]`, `.shoulder`; one empty text for a single value."""
        if self.names:
            return tuple(f'.{name}' for name in self.names)
        if self.is_list:
            return tuple(f'[{index}]' for index in self.indices)
        return ('',)

    def read(self, message) -> list:
        """Return the values in a message, as many as `suffixes`.

        They are none if an array has no entry called so: the message is of other things.

        Raises
        ------
        MissingFieldError
            If the message lacks a field, an index or a name.

        """
        parent = value = message
        for field in self.fields:
            parent = value
            if field.startswith('{'):
                value = next((entry for entry in value if _called(entry) == field[1:-1]), None)
                if value is None:
                    return []
                continue
            value = getattr(value, field, None)
            if value is None:
                raise MissingFieldError(f'{self.topic} has no field {field!r}')
        if self.names:
            order = list(getattr(parent, 'name', ()))
            if len(order) != len(value):
                raise MissingFieldError(
                    f'{self.topic} has {counted(len(value), "value")} for '
                    f'{counted(len(order), "name")}'
                )
            missing = [name for name in self.names if name not in order]
            if missing:
                raise MissingFieldError(f'{self.topic} has no {missing[0]!r} in its names')
            return [value[order.index(name)] for name in self.names]
        if self.indices:
            if len(value) <= max(self.indices):
                raise MissingFieldError(
                    f'{self.topic} has {counted(len(value), "value")}; '
                    f'expected more than {max(self.indices)}'
                )
            return [value[index] for index in self.indices]
        return [value]


def parse_field_path(text: str) -> FieldPath:
    """Read a path.

    Raises
    ------
    ValueError
        If it is malformed, has too many parts, or its slice has no fixed or too great a length.

    """
    shown = repr(text if len(text) <= 60 else f'{text[:57]}...')
    if len(text) > 16 * MAX_NAME_LENGTH:
        raise ValueError(f'a path of {len(text)} characters; at most {16 * MAX_NAME_LENGTH}')
    topic = _TOPIC.match(text)
    if topic is None:
        raise ValueError(f'{shown} is no path; expected e.g. /odom.pose.pose.position.x')
    if topic.end() > _MAX_TOPIC:
        raise ValueError(f'{shown} has a topic of {topic.end()} characters; at most {_MAX_TOPIC}')
    position, fields = topic.end(), []
    while (field := _FIELD.match(text, position)) is not None:
        fields += filter(None, field.groups())
        position = field.end()
    if len(fields) > MAX_PARTS:
        raise ValueError(f'{shown} has {len(fields)} parts; expected at most {MAX_PARTS}')
    end = _END.fullmatch(text, position)
    if end is None:
        raise ValueError(
            f'{shown} is not understood from {text[position : position + 20]!r} on; expected '
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


def _called(entry) -> str | None:
    return getattr(entry, 'name', getattr(entry, 'key', None))


def _checked_index(text: str) -> int:
    if len(text) > 8 or int(text) > _MAX_INDEX:
        raise ValueError(f'the index {text[:20]}; expected at most {_MAX_INDEX}')
    return int(text)
