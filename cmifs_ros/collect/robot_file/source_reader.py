# SPDX-License-Identifier: Apache-2.0

"""Read one `Source` from YAML: a path and its options."""

from __future__ import annotations

import math
import re

import yaml

from cmifs_ros.collect.encoders import Yaw
from cmifs_ros.core.words import first

from .encoder_reader import OPTIONS, EncoderReader
from .model import SUMMARIES, VALUE, Source
from .yaml_nodes import shown

_KEYS = ('path', 'as', *OPTIONS, 'max_age', 'inf', 'one_hot', 'over', 'type')
_TYPE = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Za-z][A-Za-z0-9]*')
_WHOLE = re.compile(r'[+-]?\d{1,18}')
#: Allowed as the last part of a channel's name, see `groups_by_name`.
_WORD = re.compile(r'[A-Za-z_][^.\[\]]*')


class SourceReader(EncoderReader):
    """Read channels, actions and values.

    Attributes
    ----------
    types : dict of str to str
        Types given so far, by topic.

    """

    def __init__(self):
        super().__init__()
        self.types: dict[str, str] = {}

    def note_type(self, node, what: str, topic: str) -> None:
        """Note the type of a topic."""
        if not (isinstance(node, yaml.ScalarNode) and _TYPE.fullmatch(node.value)):
            self.note(
                node, f'{what} is {shown(node)}; expected a type such as nav_msgs/msg/Odometry'
            )
        elif self.types.setdefault(topic, node.value) != node.value:
            self.note(node, f'{what} is {shown(node)}; expected {self.types[topic]} as above')

    def source(self, name: str, node, role: str) -> Source | None:
        """Return a source with this role; None if there is a mistake."""
        if isinstance(node, yaml.ScalarNode):
            path = self.path(node, name)
            return self._checked(Source(name, path, role=role), node) if path else None
        parts = self.mapping(node, name, _KEYS)
        if 'path' not in parts:
            self.note(node, f'{name} has no path')
            return None
        path = self.path(parts['path'], name)
        max_age = self.number(parts.get('max_age'), f'{name}.max_age', 0, math.inf, 1.0)
        encoder, inf = self.encoder(parts, name), parts.get('inf')
        if inf is not None and not (isinstance(inf, yaml.ScalarNode) and inf.value.isidentifier()
                                    and not inf.value.startswith('_')):  # fmt: skip
            self.note(inf, f'{name}.inf is {shown(inf)}; expected a field such as range_max')
            inf = None
        if path is None or ('as' in parts and encoder is None):
            return None
        if 'type' in parts:
            self.note_type(parts['type'], f'{name}.type', path.topic)
        if encoder and (path.is_list or path.names or inf):
            self.note(
                node, f'{name} has as; expected {encoder.expected}, without a slice, names in '
                'braces or inf',
            )  # fmt: skip
            return None
        categories = self._categories(parts['one_hot'], name) if 'one_hot' in parts else ()
        if categories and (len(path.suffixes) > 1 or encoder or inf or role == VALUE):
            self.note(
                node,
                f'{name} has one_hot; expected a channel of a single value, without as or inf. '
                f'Under values leave out one_hot: reward and episode compare {name} == 2, or '
                f"{name} == 'done' if it is a text",
            )
            return None
        over = self._over(parts['over'], name) if 'over' in parts else ()
        if over and (encoder or categories or (len(over) > 1 and len(path.suffixes) > 1)):
            self.note(
                node,
                f'{name} has over; expected numbers, without as or one_hot, and for several '
                'summaries a single value',
            )
        source = Source(name, path, encoder, max_age, inf and inf.value, categories, role, over)
        return self._checked(source, node)

    def _over(self, node, name: str) -> tuple[str, ...]:
        items = node.value if isinstance(node, yaml.SequenceNode) else [node]
        found = tuple(item.value for item in items if isinstance(item, yaml.ScalarNode))
        if len(found) < len(items) or not found or len(set(found) & set(SUMMARIES)) < len(found):
            said = f'[{first(found)}]' if isinstance(node, yaml.SequenceNode) else shown(node)
            self.note(
                node, f'{name}.over is {said}; expected one or some of {", ".join(SUMMARIES)}'
            )
            return ()
        return found

    def _categories(self, node, name: str) -> tuple[str, ...]:
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        texts = [item.value if isinstance(item, yaml.ScalarNode) else '' for item in items]
        categories = tuple(str(int(text)) if _WHOLE.fullmatch(text) else text for text in texts)
        if len(categories) < 2 or not any(
            all(map(p.fullmatch, categories)) for p in (_WHOLE, _WORD)
        ):
            said = f'[{first(texts)}]' if items else shown(node)
            self.note(
                node,
                f'{name}.one_hot is {said}; expected whole numbers or words, two at least, such as '
                '[0, 1, 2, 3]',
            )
        return categories

    def _checked(self, source: Source, node) -> Source | None:
        if not source.path.fields and source.encoder in (None, Yaw()):
            self.note(node, f'{source.name} is a topic without a field; expected /topic.field')
            return None
        return source
