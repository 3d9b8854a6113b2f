"""From YAML to a `RobotFile`: every mistake at once, with line, what was found and expected."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

import yaml

from cmifs_ros.collect.discount import Discount
from cmifs_ros.core import targets
from cmifs_ros.core.channel_names import problem_of_names
from cmifs_ros.core.words import first

from .expression import Expression
from .field_path import FieldPath, parse_field_path
from .model import (
    ACTION,
    CHANNEL,
    OWN_VALUES,
    RESERVED_NAMES,
    SOURCES,
    SUMMARIES,
    VALUE,
    RobotFile,
    Source,
)

MAX_SIZE = 10**6
_SOURCE_KEYS = ('path', 'as', 'max_age', 'inf', 'one_hot', 'over', 'type')
_EXPECTED = 'expected a robot file; make_robot_file writes a first one'
#: What a file must have, with an example.
_NEEDED = {
    'step': 'when a step is, such as step: {rate: 10.0}',
    'channels': 'the sensors, each as name: /topic.field',
    'reward': 'what pays, such as reward: "before(distance) - distance"; make_robot_file leaves '
    'that to you, as a TODO',
}
_KEYS = (
    'step', 'channels', 'actions', 'values', 'reward', 'episode', 'discount', 'source', 'target',
)  # fmt: skip
_ACTIONS = {'actions': 'what the robot does, each as name: /topic.field'}
_TYPE = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Za-z][A-Za-z0-9]*')


_WHOLE = re.compile(r'[+-]?\d{1,18}')
#: As the last part of a channel's name, see `groups_by_name`.
_WORD = re.compile(r'[A-Za-z_][^.\[\]]*')


class RobotFileError(ValueError):
    """A robot file cannot be used; the message has a line for each mistake."""


def load_robot_file(path: str | Path) -> RobotFile:
    """Read a robot file.

    Parameters
    ----------
    path : path-like
        `~` is the user's own folder.

    Raises
    ------
    RobotFileError
        If it cannot be read, or with all mistakes, a line each.

    """
    try:
        with open(os.path.expanduser(path), 'rb') as file:
            content = file.read(MAX_SIZE + 1)
    except OSError as error:
        raise RobotFileError(f'{path} cannot be read ({error.strerror}); {_EXPECTED}') from None
    if not content.strip():
        raise RobotFileError(f'{path} is empty; {_EXPECTED}')
    if len(content) > MAX_SIZE:
        raise RobotFileError(f'{path} has more than {MAX_SIZE} bytes; {_EXPECTED}')
    try:
        return parse_robot_file(content.decode())
    except UnicodeDecodeError:
        raise RobotFileError(f'{path} is no text; {_EXPECTED}') from None
    except RobotFileError as error:
        raise RobotFileError(f'{path}:\n{error}') from None


def parse_robot_file(text: str) -> RobotFile:
    """Read the text of a robot file; see `load_robot_file`."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError) as error:
        raise RobotFileError(f'no YAML: {" ".join(str(error).split())[:300]}') from None
    reader = _Reader()
    robot = reader.robot(root)
    if reader.mistakes:
        raise RobotFileError(
            '\n'.join(f'line {line}: {what}' for line, what in sorted(reader.mistakes))
        )
    return robot


class _Reader:
    """Walk the YAML nodes, which know their lines, and note mistakes instead of stopping."""

    def __init__(self):
        self.mistakes: list[tuple[int, str]] = []
        self._types: dict[str, str] = {}

    def _note(self, node, what: str) -> None:
        self.mistakes.append(((node.start_mark.line + 1) if node is not None else 1, what))

    def _mapping(self, node, what: str, keys: tuple[str, ...] | None) -> dict:
        if not isinstance(node, yaml.MappingNode):
            self._note(node, f'{what} is {_shown(node)}; expected a mapping')
            return {}
        found: dict = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else _shown(key)
            if keys is not None and name not in keys:
                self._note(key, f'{what} has {name[:60]!r}; expected {", ".join(keys)}')
            elif name in found:
                self._note(key, f'{what} has {name[:60]!r} twice')
            else:
                found[name] = value
        return found

    def _number(self, node, what: str, low: float, high: float, default=None):
        if node is None:
            return default
        try:
            value = float(node.value.replace('.inf', 'inf'))
        except (ValueError, AttributeError):
            value = math.nan
        if not low <= value <= high:
            self._note(node, f'{what} is {_shown(node)}; expected a number from {low} to {high}')
            return default
        return value

    def _choice(self, node, what: str, choices: Sequence[str]) -> str:
        """Return one of some words, of which the first is the default."""
        if node is None:
            return choices[0]
        if not isinstance(node, yaml.ScalarNode) or node.value not in choices:
            self._note(node, f'{what} is {_shown(node)}; expected {", ".join(choices)}')
            return choices[0]
        return node.value

    def _path(self, node, what: str) -> FieldPath | None:
        if not isinstance(node, yaml.ScalarNode):
            self._note(node, f'{what} is {_shown(node)}; expected a path such as /odom.pose')
            return None
        try:
            return parse_field_path(node.value)
        except ValueError as error:
            self._note(node, f'{what}: {error}')
            return None

    def _type(self, node, what: str, topic: str) -> None:
        if not (isinstance(node, yaml.ScalarNode) and _TYPE.fullmatch(node.value)):
            self._note(node, f'{what} is {_shown(node)}; expected e.g. nav_msgs/msg/Odometry')
        elif self._types.setdefault(topic, node.value) != node.value:
            self._note(node, f'{what} is {_shown(node)}; expected {self._types[topic]} as above')

    def _rule(self, node, what: str, known: set[str]) -> Expression | FieldPath | None:
        if node is None:
            return None
        if not isinstance(node, yaml.ScalarNode):
            self._note(node, f'{what} is {_shown(node)}; expected an expression or a path')
            return None
        if node.value.startswith('/'):
            return self._path(node, what)
        try:
            rule = Expression(node.value)
        except ValueError as error:
            self._note(node, f'{what}: {error}')
            return None
        if rule.names - known:
            self._note(
                node,
                f'{what} uses {", ".join(sorted(rule.names - known))[:60]}; expected names of '
                'channels, actions or values that are single numbers (of an array or of kinds, '
                f'name the number you mean as a value): {", ".join(sorted(known))[:300]}',
            )
        return rule

    def _source(self, name: str, node, role: str) -> Source | None:
        if isinstance(node, yaml.ScalarNode):
            path = self._path(node, name)
            return path and self._checked(Source(name, path, role=role), node)
        parts = self._mapping(node, name, _SOURCE_KEYS)
        if 'path' not in parts:
            self._note(node, f'{name} has no path')
            return None
        path = self._path(parts['path'], name)
        max_age = self._number(parts.get('max_age'), f'{name}.max_age', 0, math.inf, 1.0)
        kind, inf = parts.get('as'), parts.get('inf')
        if kind is not None and kind.value != 'yaw':
            self._note(kind, f'{name}.as is {_shown(kind)}; expected yaw')
        if inf is not None and not (isinstance(inf, yaml.ScalarNode) and inf.value.isidentifier()
                                    and not inf.value.startswith('_')):  # fmt: skip
            self._note(inf, f'{name}.inf is {_shown(inf)}; expected a field such as range_max')
            inf = None
        if path is None:
            return None
        if 'type' in parts:
            self._type(parts['type'], f'{name}.type', path.topic)
        if kind is not None and (path.is_list or path.names):
            self._note(node, f'{name} is a yaw of several values; expected one quaternion')
            return None
        kinds = self._kinds(parts['one_hot'], name) if 'one_hot' in parts else ()
        if kinds and (len(path.suffixes) > 1 or kind or inf or role == VALUE):
            self._note(
                node,
                f'{name} has one_hot; expected a channel of a single value, without as and inf. '
                'In reward and episode, compare the number: name == 2',
            )
            return None
        over = self._over(parts['over'], name) if 'over' in parts else ()
        if over and (kind or kinds or (len(over) > 1 and len(path.suffixes) > 1)):
            self._note(
                node,
                f'{name} has over; expected numbers, without as and one_hot, and for several '
                'summaries a single value',
            )
        source = Source(name, path, kind is not None, max_age, inf and inf.value, kinds, role, over)
        return self._checked(source, node)

    def _over(self, node, name: str) -> tuple[str, ...]:
        items = node.value if isinstance(node, yaml.SequenceNode) else [node]
        found = tuple(item.value for item in items if isinstance(item, yaml.ScalarNode))
        if len(found) < len(items) or not found or len(set(found) & set(SUMMARIES)) < len(found):
            shown = f'[{first(found)}]' if isinstance(node, yaml.SequenceNode) else _shown(node)
            self._note(
                node, f'{name}.over is {shown}; expected one or some of {", ".join(SUMMARIES)}'
            )
            return ()
        return found

    def _kinds(self, node, name: str) -> tuple[str, ...]:
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        texts = [item.value if isinstance(item, yaml.ScalarNode) else '' for item in items]
        kinds = tuple(str(int(text)) if _WHOLE.fullmatch(text) else text for text in texts)
        if len(kinds) < 2 or not any(all(map(p.fullmatch, kinds)) for p in (_WHOLE, _WORD)):
            shown = f'[{first(texts)}]' if items else _shown(node)
            self._note(
                node, f'{name}.one_hot is {shown}; expected whole numbers or words, two at least, '
                'such as [0, 1, 2, 3]',
            )  # fmt: skip
        return kinds

    def _checked(self, source: Source, node) -> Source | None:
        if not source.path.fields:
            self._note(node, f'{source.name} is a topic without a field; expected /topic.field')
            return None
        return source

    def _clock(self, node) -> tuple[str | None, float | None]:
        """Return the step's topic and rate, of which one is None."""
        step = self._mapping(node, 'step', ('topic', 'rate', 'type'))
        if ('topic' in step) == ('rate' in step):
            self._note(node, 'step has neither or both of topic and rate; expected one')
        rate = self._number(step.get('rate'), 'step.rate', 0.001, 10_000)
        clock = self._path(step['topic'], 'step.topic') if 'topic' in step else None
        if clock is not None and clock.fields:
            self._note(step['topic'], 'step.topic names a field; expected a topic such as /odom')
        if 'type' in step and clock is not None:
            self._type(step['type'], 'step.type', clock.topic)
        elif 'type' in step:
            self._note(step['type'], 'step.type stands without step.topic')
        return clock and clock.topic, rate

    def _discount(self, node) -> Discount:
        found = self._mapping(node, 'discount', ('gamma', 'half_life'))
        if len(found) != 1:
            self._note(node, 'discount has neither or both of gamma and half_life; expected one')
        gamma = self._number(found.get('gamma'), 'discount.gamma', 0.0, 1.0)
        if gamma == 0:
            self._note(node, 'discount.gamma is 0; expected more, up to 1')
        return Discount(
            gamma, self._number(found.get('half_life'), 'discount.half_life', 0.001, 10**9)
        )

    def _sources(self, top: dict) -> tuple[list[Source | None], set[str]]:
        """Return all sources, None where one has a mistake, and the names of all."""
        sources, keys = [], set()
        for section, role in (('channels', CHANNEL), ('actions', ACTION), ('values', VALUE)):
            if section in top:
                for name, node in self._mapping(top[section], section, None).items():
                    if name in RESERVED_NAMES:
                        self._note(
                            node, f'{section} has {name!r}, which has a meaning of its own in '
                            'expressions; expected another name',
                        )  # fmt: skip
                    elif name in keys:
                        self._note(
                            node, f'{section} has {name[:60]!r}, which stands above already'
                        )  # fmt: skip
                    keys.add(name)
                    sources.append(self._source(name, node, role))
        return sources, keys

    def robot(self, root) -> RobotFile | None:
        """Read everything; None if a mistake leaves no robot."""
        top = self._mapping(root, 'the file', _KEYS)
        target = self._choice(top.get('target'), 'target', targets.TARGETS)
        source = self._choice(top.get('source'), 'source', SOURCES)
        for key, example in _needed_for(target).items():
            if key not in top and root is not None:
                line = max(root.end_mark.line, 1)
                self.mistakes.append((line, f'the file has no {key!r}; add {example}'))
        clock, rate = self._clock(top['step']) if 'step' in top else (None, None)
        sources, keys = self._sources(top)
        found = tuple(source for source in sources if source is not None)
        names = [name for source in found for name in source.names]
        for key in ('channels', 'actions'):
            if key in top and isinstance(top[key], yaml.MappingNode) and not top[key].value:
                self._note(top[key], f'no {key}; expected at least one')
        problem = problem_of_names(names)
        if problem:
            self._note(top.get('channels'), f'the channels have {problem}')
        # What could not be read counts as known, so that one mistake is told once.
        known = OWN_VALUES | {s.name for s in found if s.names == (s.name,)}
        known |= keys - {source.name for source in found}
        reward = self._rule(top.get('reward'), 'reward', known)
        if isinstance(reward, FieldPath) and not reward.fields:
            self._note(top['reward'], 'reward is a topic without a field')
        episode = (
            self._mapping(top['episode'], 'episode', ('action', 'terminated', 'truncated', 'steps'))
            if 'episode' in top
            else {}
        )
        terminated = self._rule(episode.get('terminated'), 'episode.terminated', known)
        truncated = self._rule(episode.get('truncated'), 'episode.truncated', known)
        action = self._path(episode['action'], 'episode.action') if 'action' in episode else None
        steps = self._number(episode.get('steps'), 'episode.steps', 1, 10**6)
        discount = self._discount(top['discount']) if 'discount' in top else None
        if self.mistakes:
            return None
        return RobotFile(
            clock, rate, found, reward, terminated, truncated,
            action and action.topic, steps and int(steps), self._types, discount, source, target,
        )  # fmt: skip


def _needed_for(target: str) -> dict[str, str]:
    """Return what a file must have, with examples: for the action as target no reward."""
    if target != targets.ACTION:
        return _NEEDED
    return {key: example for key, example in _NEEDED.items() if key != 'reward'} | _ACTIONS


def _shown(node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return repr(node.value[:60]) if node.value else 'empty'
    return {yaml.MappingNode: 'a mapping', yaml.SequenceNode: 'a list'}.get(type(node), 'nothing')
