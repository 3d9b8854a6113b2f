"""A first robot file from what topics carry: every numeric field of every topic is a channel.

What never changed there, or was never a number, is commented out, and told why.
"""

from __future__ import annotations

import json
import keyword
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from cmifs_ros.collect.sampling.bag_reader import Undecoded, messages_of, open_bag, unwatched
from cmifs_ros.core.words import first

from .field_path import MAX_PARTS, FieldPath, MissingFieldError, parse_field_path
from .model import OWN_VALUES, STATUS, Source

#: Of a longer array so many values are taken, evenly spaced.
MAX_SLICE = 12
#: Of a bag's topic about so many messages are looked at, evenly spaced, and of those of no more
#: bytes than this each that differs from the one before: a bumper is hit rarely.
MAX_LOOKS, MAX_SHORT = 1000, 64
#: An integer with so many values may be one of kinds.
_FEWEST_KINDS, _MOST_KINDS = 3, 8
_OF_ROS = ('/rosout', '/parameter_events', '/clock')
_QUATERNION = 'geometry_msgs/msg/Quaternion'
_TIMES = ('builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration', 'std_msgs/msg/Header')
_NO_NUMBERS = ('string', 'wstring')
#: An array of these is a picture, or another file.
BYTES = ('uint8', 'byte', 'octet')
_IN_BRACES = re.compile(r'[^{},\s"\\]+')


class _Field:
    """A numeric field of a topic's messages, and what its values did so far."""

    def __init__(self, path: FieldPath, text: str, value, is_yaw: bool, inf: str | None):
        self.path, self.text = path, text
        self.options = ', as: yaw' if is_yaw else f', inf: {inf}' if inf else ''
        self._source = Source('', path, is_yaw, inf=inf)
        self._newest: list[float] = []
        self._first = [math.nan] * len(self._source.names)
        self._is_changed = False
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        self._kinds: set[int] | None = set() if is_whole else None

    @property
    def is_open(self) -> bool:
        """Whether another message could tell something."""
        return not self._is_changed or self._kinds is not None or any(map(math.isnan, self._first))

    def look(self, message) -> None:
        """Take in the values of a message."""
        try:
            self._newest = self._source.read(message)
        except MissingFieldError:  # an array that is shorter now, a joint that is not in this one
            return
        for i, value in enumerate(self._newest):
            if math.isfinite(value):
                if math.isnan(self._first[i]):
                    self._first[i] = value
                self._is_changed |= value != self._first[i]
        if self._kinds is not None:
            self._kinds.add(int(self._newest[0]))
            if len(self._kinds) > _MOST_KINDS:
                self._kinds = None

    @property
    def why_not(self) -> str:
        """Why it is no channel, or nothing."""
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
    def kinds(self) -> str:
        """The few values of an integer, or nothing."""
        if self._kinds is None or len(self._kinds) < _FEWEST_KINDS:
            return ''
        return ', '.join(map(str, sorted(self._kinds)))


def _shown(value: float) -> str:
    return 'NaN' if math.isnan(value) else f'{value:.6g}'


class Heard:
    """What was heard of a topic.

    Parameters
    ----------
    topic : str
    kind : str
        The name of its type.
    fields_of : callable
        From the name of a message type to its fields (`TypeField`), in order.
    count : int, optional
        How many messages came.

    Attributes
    ----------
    count : int
    num_unseen : int
        Messages that may have told something more, but were not looked at.
    problem : str
        Why none was looked at, if none was.
    fields : list or None
        Its numeric fields; None before a message was looked at.

    """

    def __init__(self, topic: str, kind: str, fields_of: Callable, count: int = 0):
        self.topic, self.kind, self.count = topic, kind, count
        self.num_unseen = 0
        self.problem = ' has no messages'
        self.fields: list[_Field] | None = None
        self._open: list[_Field] = []
        self._fields_of = fields_of

    @property
    def is_open(self) -> bool:
        """Whether another message could tell something."""
        return self.fields is None or bool(self._open)

    def look(self, message) -> None:
        """Take in the values of a message."""
        if self.fields is None:
            self.fields = list(_numbers(self._fields_of, self.kind, message, self.topic))
            self._open = self.fields
        for field in self._open:
            field.look(message)
        self._open = [field for field in self._open if field.is_open]


class TypeField(NamedTuple):
    """A field of a message type: its name and what it is.

    It is 'number', 'numbers' (an array) or the name of a message type; what else it may be has no
    numbers.
    """

    name: str
    what: str


def robot_file_of_bag(
    path: str | Path, watch: Callable[[Iterable, int], Iterable] = unwatched
) -> str:
    """Return the text of a robot file with all channels of a bag.

    It is valid but for the reward, which only its user knows.

    Parameters
    ----------
    path : path
        A file or a folder.
    watch : callable, optional
        As that of `episodes_of_bag`.

    Raises
    ------
    BagError
        If the bag cannot be read.

    """
    with open_bag(path) as reader:
        definitions = reader.typestore.fielddefs

        def fields_of(kind: str) -> list[TypeField]:
            return [TypeField(name, _what(node)) for name, node in definitions[kind][1]]

        heard = {
            topic: Heard(topic, info.msgtype, fields_of, info.msgcount)
            for topic, info in reader.topics.items()
        }
        topics = {topic for topic in heard if is_of_robot(topic)}
        total = sum(heard[topic].count for topic in topics)
        messages = messages_of(reader, path, topics, _Choice(heard))
        for topic, message, _ in watch(messages, total):
            if not isinstance(message, Undecoded):
                heard[topic].look(message)
            elif message.cause:
                heard[topic].problem = f': {message.cause}'
        return robot_file_of_topics(Path(path).name, heard.values(), reader.duration / 1e9)


class _Choice:
    """Choose the messages of a bag that are looked at."""

    def __init__(self, heard: dict[str, Heard]):
        self._heard = heard
        self._counts: Counter[str] = Counter()
        self._last: dict[str, bytes] = {}

    def __call__(self, topic: str, data: bytes) -> bool:
        heard = self._heard[topic]
        if not heard.is_open:
            return False
        self._counts[topic] += 1
        if len(data) <= MAX_SHORT:
            is_same = data == self._last.get(topic)
            self._last[topic] = data
            return not is_same
        is_chosen = (self._counts[topic] - 1) % -(-heard.count // MAX_LOOKS) == 0
        heard.num_unseen += not is_chosen
        return is_chosen


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
) -> str:
    """Return the text of a robot file with all channels of some topics.

    Parameters
    ----------
    title : str
        Where they were heard.
    heard : iterable of Heard
    seconds : float
        For how long.

    """
    channels: list[tuple[_Field, Heard, str]] = []
    without: list[str] = []
    actions: list[str] = []
    for one in sorted(heard, key=lambda h: h.topic):
        if one.topic.endswith(STATUS):
            actions.append(one.topic.removesuffix(STATUS))
        if not is_of_robot(one.topic):
            continue
        if one.fields is None:
            without.append(f'{one.topic}{one.problem}')
        elif not one.fields:
            without.append(f'{one.topic} ({one.kind}) has no numeric field')
        else:
            age = _max_age(seconds, one.count)
            channels += [(field, one, age) for field in one.fields]
    lines = [
        _channel(name, *channel)
        for name, channel in zip(_names([f for f, _, _ in channels]), channels, strict=True)
    ]
    return _text(title, lines + [f'# {what}' for what in without], actions)


def _channel(name: str, field: _Field, heard: Heard, age: str) -> str:
    """Return the line of a channel."""
    path, options = json.dumps(field.text), field.options + age
    line = f'{name}: ' + (f'{{path: {path}{options}}}' if options else path)
    if field.why_not:
        unseen, count = heard.num_unseen, heard.count
        seen = f', in {count - unseen} of {count} messages' if unseen else ''
        return f'  # {line}  # {field.why_not}{seen}'
    if field.kinds:
        line += f'  # if {field.kinds} are kinds: '
        line += f'{{path: {path}{options}, one_hot: [{field.kinds}]}}'
    return f'  {line}'


def is_of_robot(topic: str) -> bool:
    """Tell whether a topic may be a sensor's: neither ROS's own nor an action's."""
    return topic not in _OF_ROS and '/_action/' not in topic


def _max_age(seconds: float, count: int) -> str:
    """Return the option for a topic that comes less often than twice a second."""
    if count <= 1:
        return ', max_age: .inf'
    period = seconds / count
    return f', max_age: {math.ceil(3 * period)}.0' if period > 0.5 else ''


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
        if what in ('number', 'numbers', _QUATERNION):
            end = _end(name, value, list(getattr(message, 'name', ()))) if what == 'numbers' else ''
            has_inf = name == 'ranges' and hasattr(message, 'range_max')
            text = '.'.join((topic, *fields)) + end
            try:
                path = parse_field_path(text)
            except ValueError:  # No robot file could name it.
                continue
            if what != 'numbers' or end:
                inf = 'range_max' if has_inf else None
                yield _Field(path, text, value, what == _QUATERNION, inf)
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
        [part for part, _ in groupby((*path.topic.strip('/').split('/'), *path.fields))]
        for path in (field.path for field in found)  # `groupby`: not pose_pose
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


def _text(title: str, channels: list[str], actions: list[str]) -> str:
    lines = [
        f'# Written by make_robot_file from {json.dumps(title)[1:-1]}. Decide what is marked TODO,',
        '# and remove channels that cannot matter: the more there are, the more episodes it takes.',
        '# What never changed, or never was a number, is commented out: was the robot at its task?',
        '',
        '# TODO: a step so many times a second, or at each message of a topic: {topic: /odom}.',
        'step: {rate: 10.0}',
        '',
        'channels:',
        *channels,
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
