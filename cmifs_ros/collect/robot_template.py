"""A first robot file from what topics carry: every numeric field of every topic is a channel."""

from __future__ import annotations

import json
import keyword
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from .bag import messages_of, open_bag
from .field_path import MAX_PARTS, parse_field_path
from .robot_file import OWN_VALUES, STATUS

#: Of a longer array so many values are taken, evenly spaced.
MAX_SLICE = 12
_OF_ROS = ('/rosout', '/parameter_events', '/clock')
_QUATERNION = 'geometry_msgs/msg/Quaternion'
_TIMES = ('builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration', 'std_msgs/msg/Header')
_NO_NUMBERS = ('string', 'wstring')
#: An array of these is a picture, or another file.
BYTES = ('uint8', 'byte', 'octet')
_IN_BRACES = re.compile(r'[^{},\s"\\]+')


@dataclass(frozen=True)
class _Field:
    topic: str
    fields: tuple[str, ...]
    end: str = ''
    options: str = ''

    @property
    def path(self) -> str:
        return '.'.join((self.topic, *self.fields)) + self.end


class Heard(NamedTuple):
    """What was heard of a topic: its type, its first message (or None), and how many came."""

    topic: str
    kind: str
    first: object | None
    count: int


class TypeField(NamedTuple):
    """A field of a message type: its name and what it is.

    It is 'number', 'numbers' (an array) or the name of a message type; what else it may be has no
    numbers.
    """

    name: str
    what: str


def robot_file_of_bag(path: str | Path) -> str:
    """Return the text of a robot file with all channels of a bag.

    It is valid but for the reward, which only its user knows.

    Raises
    ------
    BagError
        If the bag cannot be read.

    """
    with open_bag(path) as reader:
        heard = [
            Heard(topic, info.msgtype, next(messages_of(reader, path, [topic]))[1], info.msgcount)
            if info.msgcount and is_of_robot(topic)
            else Heard(topic, info.msgtype, None, info.msgcount)
            for topic, info in reader.topics.items()
        ]
        definitions = reader.typestore.fielddefs
        return robot_file_of_topics(
            Path(path).name,
            heard,
            reader.duration / 1e9,
            lambda kind: [TypeField(name, _what(node)) for name, node in definitions[kind][1]],
        )


def _what(node: tuple) -> str:
    """Return what a field of rosbags' is, see `TypeField`."""
    kind, inner = node[0].name, node[1]
    if kind == 'NAME':
        return inner
    element = node if kind == 'BASE' else inner[0]
    if element[0].name != 'BASE' or element[1][0] in _NO_NUMBERS:
        return ''
    if kind == 'BASE':
        return 'number'
    return '' if element[1][0] in BYTES else 'numbers'


def robot_file_of_topics(
    title: str,
    heard: Iterable[Heard],
    seconds: float,
    fields_of: Callable[[str], Iterable[TypeField]],
) -> str:
    """Return the text of a robot file with all channels of some topics.

    Parameters
    ----------
    title : str
        Where they were heard.
    heard : iterable of Heard
    seconds : float
        For how long.
    fields_of : callable
        From the name of a message type to its fields, in order.

    """
    found: list[_Field] = []
    without: list[str] = []
    actions: list[str] = []
    for topic, kind, first, count in sorted(heard, key=lambda h: h.topic):
        if topic.endswith(STATUS):
            actions.append(topic.removesuffix(STATUS))
        if not is_of_robot(topic):
            continue
        if first is None:
            without.append(f'{topic} has no messages')
            continue
        age = _max_age(seconds, count)
        fields = [
            replace(field, options=field.options + age)
            for field in _numbers(fields_of, kind, first, topic)
            if _is_path(field.path)
        ]
        found += fields
        if not fields:
            without.append(f'{topic} ({kind}) has no numeric field')
    return _text(title, found, without, actions)


def is_of_robot(topic: str) -> bool:
    """Tell whether a topic may be a sensor's: neither ROS's own nor an action's."""
    return topic not in _OF_ROS and '/_action/' not in topic


def _max_age(seconds: float, count: int) -> str:
    """Return the option for a topic that comes less often than twice a second."""
    if count <= 1:
        return ', max_age: .inf'
    period = seconds / count
    return f', max_age: {math.ceil(3 * period)}.0' if period > 0.5 else ''


def _is_path(text: str) -> bool:
    try:
        parse_field_path(text)
    except ValueError:
        return False
    return True


def _numbers(
    fields_of: Callable, kind: str, message, topic: str, above: tuple[str, ...] = ()
) -> Iterator[_Field]:
    """Yield the numeric fields of a type; a message says how long its arrays are."""
    if len(above) >= MAX_PARTS:
        return
    for name, what in fields_of(kind):
        fields = (*above, name)
        value = getattr(message, name, None)
        if value is None or not what or name == 'structure_needs_at_least_one_member':
            continue
        if what == 'number':
            yield _Field(topic, fields)
        elif what == 'numbers':
            end = _end(name, value, list(getattr(message, 'name', ())))
            inf = ', inf: range_max' if name == 'ranges' and hasattr(message, 'range_max') else ''
            if end:
                yield _Field(topic, fields, end, inf)
        elif what == _QUATERNION:
            yield _Field(topic, fields, '', ', as: yaw')
        elif what not in _TIMES:
            yield from _numbers(fields_of, what, value, topic, fields)


def _end(name: str, values: Sequence, names: list[str]) -> str:
    """Return what takes the values of an array: by name, the diagonal, or evenly spaced."""
    length = len(values)
    if length == 0:
        return ''
    is_named = len(names) == length == len(set(names))
    if is_named and all(isinstance(n, str) and _IN_BRACES.fullmatch(n) for n in names):
        return f'{{{",".join(names)}}}'
    if 'covariance' in name and math.isqrt(length) ** 2 == length and length > 1:
        return f'[0:{length}:{math.isqrt(length) + 1}]'
    stride = -(-length // MAX_SLICE)
    return f'[0:{length}:{stride}]' if stride > 1 else f'[0:{length}]'


def _names(found: list[_Field]) -> list[str]:
    """Return a name for each: its last parts, as many as tell it from the others."""
    parts = [
        [part for part, _ in groupby((*f.topic.strip('/').split('/'), *f.fields))]  # not pose_pose
        for f in found
    ]
    longest = max(map(len, parts), default=0)
    counts = [Counter('_'.join(p[-k:]) for p in parts) for k in range(1, longest + 1)]
    names: list[str] = []
    for own in parts:
        candidates = ['_'.join(own[-k:]) for k in range(1, len(own) + 1)]
        unique = [
            name
            for name, count in zip(candidates, counts, strict=False)
            if count[name] == 1 and name not in OWN_VALUES and name != 'data'
            and not keyword.iskeyword(name) and name != 'before'
        ]  # fmt: skip
        name = unique[0] if unique else candidates[-1]
        taken = [*names, *OWN_VALUES]
        number = 2
        while name in taken:
            name, number = f'{candidates[-1]}_{number}', number + 1
        names.append(name)
    return names


def _text(title: str, found: list[_Field], without: list[str], actions: list[str]) -> str:
    lines = [
        f'# Written by make_robot_file from {json.dumps(title)[1:-1]}. Decide what is marked TODO,',
        '# and remove channels that cannot matter: the more there are, the more episodes it takes.',
        '',
        '# TODO: a step so many times a second, or at each message of a topic: {topic: /odom}.',
        'step: {rate: 10.0}',
        '',
        'channels:' if found else '# There is no numeric field: expected at least one channel.',
    ]
    for name, field in zip(_names(found), found, strict=True):
        path = json.dumps(field.path)
        lines.append(
            f'  {name}: ' + (f'{{path: {path}{field.options}}}' if field.options else path)
        )
    lines += [f'# {what}' for what in without]
    lines += [
        '',
        '# TODO: what pays, of the values of channels; before(name) is the value of the step left.',
        '# Values that are no sensors, such as the distance to the goal, belong under `values:`.',
        '# reward: "before(distance) - distance"',
        '',
        '# TODO: when an episode ends: after so many steps, with an action or a condition, such as',
    ]
    lines += [f'# episode: {{action: {action}}}' for action in actions or ['/navigate_to_pose']]
    lines += ['# episode: {terminated: "distance < 0.1", steps: 300}', 'episode: {steps: 25}']
    return '\n'.join(lines) + '\n'
