# SPDX-License-Identifier: Apache-2.0

"""Values from JSON in a file or message, which are not trusted: each must be what is expected."""

from __future__ import annotations

from cmifs_ros.core.channel_names import MAX_NAME_LENGTH

#: Most characters of a text.
_MAX_TEXT = 1000


def flag_of(value) -> bool:
    """Return a value that must be a boolean; otherwise raise TypeError."""
    if not isinstance(value, bool):
        raise TypeError(f'{value!r} instead of true or false')
    return value


def number_or_none(value) -> float | None:
    """Return a value that must be a number or null."""
    return None if value is None else float(value)


def one_of(expected: tuple[str, ...], value, what: str) -> str:
    """Return a value that must be one of those expected; otherwise raise ValueError."""
    if value not in expected:
        raise ValueError(f'{what} {value!r:.40}; expected one of {", ".join(expected)}')
    return value


def list_of(value) -> list:
    """Return a value that must be a list; otherwise raise TypeError."""
    if not isinstance(value, list):
        raise TypeError(f'{type(value).__name__} instead of a list')
    return value


def count_of(value, least: int = 0) -> int:
    """Return a value that must be an integer of at least `least`; otherwise raise ValueError."""
    if type(value) is not int or value < least:
        raise ValueError(f'{value!r} instead of an integer of at least {least}')
    return value


def text_of(value, least: int = 0, most: int = _MAX_TEXT) -> str:
    """Return a value that must be a text of limited length; otherwise raise ValueError."""
    if not isinstance(value, str) or not least <= len(value) <= most:
        length = f'{least} to {most}' if least else f'at most {most}'
        raise ValueError(f'{value!r:.40} instead of a text of {length} characters')
    value.encode()  # UnicodeEncodeError, a ValueError: messages and logs have no surrogates.
    return value


def name_of(value) -> str:
    """Return a value that must be a name; otherwise raise ValueError."""
    return text_of(value, 1, MAX_NAME_LENGTH)


def names_of(value, most: int) -> tuple[str, ...]:
    """Return a value that must be a list of distinct names; otherwise raise ValueError."""
    names = tuple(map(name_of, list_of(value)))
    if len(names) > most or len(set(names)) < len(names):
        raise ValueError(f'{len(names)} names; expected at most {most}, all distinct')
    return names
