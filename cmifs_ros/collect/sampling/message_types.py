# SPDX-License-Identifier: Apache-2.0

"""The message types of a bag, as the bag defines them, decoded by rosbags."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Protocol

from cmifs_ros.collect.robot_file.observed_fields import BYTES, TypeField

from .storages import Connection

#: Supported serialisation formats.
_DECODED = ('cdr', 'ros1')
#: Separator of the types in a definition.
_IDL = re.compile(r'(?m)^=+\nIDL: .*\n')


class MessageTypes(Protocol):
    """The types of a bag's topics.

    Attributes
    ----------
    unreadable : dict of str to str
        By topic, why none of its messages can be decoded.

    """

    unreadable: dict[str, str]

    def decode(self, connection: Connection, data: bytes) -> object:
        """Decode a message; pass on any exception of its decoder."""

    def fields_of(self, kind: str) -> list[TypeField]:
        """Return the fields of a type, in order."""


class RosbagsTypes:
    """`MessageTypes` by rosbags, with the types that the bag defines.

    Attributes
    ----------
    store
        The types, as rosbags holds them.

    """

    def __init__(self, connections: Iterable[Connection]):
        self.store, self.unreadable = _typestore(connections)

    def decode(self, connection: Connection, data: bytes) -> object:
        """Return a message."""
        if connection.serialization == 'ros1':
            return self.store.deserialize_ros1(data, connection.msgtype)
        return self.store.deserialize_cdr(data, connection.msgtype)

    def fields_of(self, kind: str) -> list[TypeField]:
        """Return the fields of a type, in order."""
        return [TypeField(name, _what(node)) for name, node in self.store.fielddefs[kind][1]]


def _typestore(connections: Iterable[Connection]) -> tuple[Any, dict[str, str]]:
    """Return the types of a bag, and by topic why messages cannot be decoded."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    jazzy = get_typestore(Stores.ROS2_JAZZY).fielddefs
    types: dict = {}
    causes: dict[str, str] = {}
    for connection in connections:
        kind, encoding, text = connection.msgtype, connection.encoding, connection.definition
        if connection.serialization not in _DECODED:
            causes[connection.topic] = (
                f'its messages are {connection.serialization or "in an unknown format"}; '
                f'expected {" or ".join(_DECODED)}'
            )
        elif kind in types:
            continue
        elif not text.strip():  # Files before Iron have none; it is empty for an empty message.
            if kind not in jazzy:
                causes[connection.topic] = f'the bag does not define its type {kind or "at all"}'
        else:
            try:
                if encoding == 'ros2msg':
                    found = get_types_from_msg(text, kind)
                else:
                    found = {}
                    for part in _IDL.split(text):
                        found |= get_types_from_idl(part) if part.strip() else {}
                get_typestore(Stores.EMPTY).register(found)
                types |= found
            except Exception as error:  # Invalid texts make the parsers raise almost anything.
                causes[connection.topic] = f'its type {kind} cannot be read: {shown(error)}'
    typestore = get_typestore(Stores.EMPTY)
    typestore.register({**jazzy, **types})
    return typestore, causes


def _what(node: tuple) -> str:
    """Return a field of rosbags as a `TypeField`."""
    kind, inner = node[0].name, node[1]
    is_array = kind not in ('BASE', 'NAME')
    element_kind, element = (inner[0][0].name, inner[0][1]) if is_array else (kind, inner)
    if element_kind == 'NAME':
        return f'{element}[]' if is_array else element
    if element[0] in ('string', 'wstring'):
        return '' if is_array else 'text'
    if not is_array:
        return 'number'
    return '' if element[0] in BYTES else 'numbers'


def shown(error: Exception) -> str:
    """Return a short text of an error from another package."""
    return f'{type(error).__name__}: {" ".join(str(error).split())[:300]}'
