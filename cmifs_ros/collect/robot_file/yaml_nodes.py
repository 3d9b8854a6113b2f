# SPDX-License-Identifier: Apache-2.0

"""Read values from YAML nodes; collect mistakes with their lines instead of raising."""

from __future__ import annotations

import math
from collections.abc import Sequence

import yaml

from cmifs_ros.core.words import did_you_mean

from .field_path import FieldPath, parse_field_path


class Nodes:
    """Read values from nodes.

    Attributes
    ----------
    mistakes : list of (int, str)
        Line, and a message of what was found and expected.

    """

    def __init__(self):
        self.mistakes: list[tuple[int, str]] = []

    def note(self, node, what: str) -> None:
        """Note a mistake at a node."""
        self.mistakes.append(((node.start_mark.line + 1) if node is not None else 1, what))

    def mapping(self, node, what: str, keys: tuple[str, ...] | None) -> dict:
        """Return the nodes of a mapping by key; `None` allows all keys."""
        if not isinstance(node, yaml.MappingNode):
            self.note(node, f'{what} is {shown(node)}; expected a mapping')
            return {}
        found: dict = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else shown(key)
            if keys is not None and name not in keys:
                meant = did_you_mean(name, keys)
                self.note(key, f'{what} has {name[:60]!r}{meant}; expected {", ".join(keys)}')
            elif name in found:
                self.note(key, f'{what} has {name[:60]!r} twice')
            else:
                found[name] = value
        return found

    def number(
        self, node, what: str, low: float, high: float, default=None, *, is_whole: bool = False
    ):
        """Return a number within bounds, or the default."""
        if node is None:
            return default
        try:
            value = float(node.value.replace('.inf', 'inf'))
        except (ValueError, AttributeError):
            value = math.nan
        if not low <= value <= high or (is_whole and not value.is_integer()):
            kind = 'a whole number' if is_whole else 'a number'
            self.note(node, f'{what} is {shown(node)}; expected {kind} from {low} to {high}')
            return default
        return int(value) if is_whole else value

    def choice(self, node, what: str, choices: Sequence[str]) -> str:
        """Return one of some words; the first one if there is a mistake."""
        if not isinstance(node, yaml.ScalarNode) or node.value not in choices:
            self.note(node, f'{what} is {shown(node)}; expected {", ".join(choices)}')
            return choices[0]
        return node.value

    def path(self, node, what: str) -> FieldPath | None:
        """Return a path; None if there is a mistake."""
        if not isinstance(node, yaml.ScalarNode):
            self.note(node, f'{what} is {shown(node)}; expected a path such as /odom.pose')
            return None
        try:
            return parse_field_path(node.value)
        except ValueError as error:
            self.note(node, f'{what}: {error}')
            return None


def shown(node) -> str:
    """Return the contents of a node as text."""
    if isinstance(node, yaml.ScalarNode):
        return repr(node.value[:60]) if node.value else 'empty'
    return {yaml.MappingNode: 'a mapping', yaml.SequenceNode: 'a list'}.get(type(node), 'nothing')
