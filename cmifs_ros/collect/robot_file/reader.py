# SPDX-License-Identifier: Apache-2.0

"""Read a `RobotFile` from YAML; report all mistakes at once, with lines and expectations."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import yaml

from cmifs_ros.collect.discount import Discount
from cmifs_ros.core import targets
from cmifs_ros.core.channel_names import problem_of_names

from .field_path import FieldPath
from .model import (
    ACTION,
    CHANNEL,
    OWN_VALUES,
    RESERVED_NAMES,
    SOURCES,
    VALUE,
    RobotFile,
    SavingCycle,
    Source,
)
from .rule_reader import RuleReader

MAX_SIZE = 10**6
_EXPECTED = 'expected a robot file; make_robot_file writes a first one'
#: Required keys, with examples.
_NEEDED = {
    'step': 'how steps are made, such as step: {rate: 10.0}',
    'channels': 'the sensors, each as name: /topic.field',
    'reward': 'the reward, such as reward: "before(distance) - distance"; make_robot_file '
    'leaves it as a TODO',
}
_ACTIONS = {'actions': 'what the robot does, each as name: /topic.field'}
_KEYS = (
    'step', 'channels', 'actions', 'values', 'reward', 'episode', 'discount', 'source', 'target',
    'saving',
)  # fmt: skip


class RobotFileError(ValueError):
    """A robot file is invalid; the message has a line for each mistake."""


def load_robot_file(path: str | Path) -> RobotFile:
    """Read a robot file.

    Parameters
    ----------
    path : path-like
        `~` is the user's home folder.

    Raises
    ------
    RobotFileError
        If it cannot be read, or is invalid: all mistakes, one per line.

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
        raise RobotFileError(f'{path} is not a text file; {_EXPECTED}') from None
    except RobotFileError as error:
        raise RobotFileError(f'{path}:\n{error}') from None


def parse_robot_file(text: str) -> RobotFile:
    """Read the text of a robot file; see `load_robot_file`."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError) as error:
        raise RobotFileError(_not_yaml(text, error)) from None
    reader = _FileReader()
    robot = reader.robot(root)
    if robot is None or reader.mistakes:
        raise RobotFileError(
            '\n'.join(f'line {line}: {what}' for line, what in sorted(reader.mistakes))
        )
    return robot


def _not_yaml(text: str, error: Exception) -> str:
    mark = getattr(error, 'problem_mark', None)
    if mark is None:
        return f'not valid YAML: {" ".join(str(error).split())[:300]}'
    # What the parser stumbles over may be in the line after the mistake.
    lines = [f'{line} ' for line in text.splitlines()[max(mark.line - 1, 0) : mark.line + 1]]
    hint = ''
    if any(bracket in line for line in lines for bracket in '[{'):
        hint = '; put quotes around a path with [ ] or { }'
    return f'line {mark.line + 1}: not valid YAML ({getattr(error, "problem", "")}){hint}'


class _FileReader(RuleReader):
    """Read the whole file."""

    def _step(self, node) -> tuple[str | None, float | None]:
        """Return the topic and the rate of steps, one of which is None."""
        step = self.mapping(node, 'step', ('topic', 'rate', 'type'))
        if ('topic' in step) == ('rate' in step):
            self.note(node, 'step has neither or both of topic and rate; expected one')
        rate = self.number(step.get('rate'), 'step.rate', 0.001, 10_000)
        path = self.path(step['topic'], 'step.topic') if 'topic' in step else None
        if path is not None and path.fields:
            self.note(step['topic'], 'step.topic names a field; expected a topic such as /odom')
        if 'type' in step and path is not None:
            self.note_type(step['type'], 'step.type', path.topic)
        elif 'type' in step:
            self.note(step['type'], 'step.type is given without step.topic')
        return path.topic if path else None, rate

    def _discount(self, node) -> Discount:
        found = self.mapping(node, 'discount', ('gamma', 'half_life'))
        if len(found) != 1:
            self.note(node, 'discount has neither or both of gamma and half_life; expected one')
        gamma = self.number(found.get('gamma'), 'discount.gamma', 0.0, 1.0)
        if gamma == 0:
            self.note(node, 'discount.gamma is 0; expected more, up to 1')
        return Discount(
            gamma, self.number(found.get('half_life'), 'discount.half_life', 0.001, 10**9)
        )

    def _saving(self, node, top: dict) -> SavingCycle:
        names = [field.name for field in dataclasses.fields(SavingCycle)]
        found = self.mapping(node, 'saving', tuple(names))
        if 'episode' not in top:
            self.note(node, 'saving needs episode, because it counts episodes; add episode')
        given = {
            name: self.number(value, f'saving.{name}', 1, 10**6, 1, is_whole=True)
            for name, value in found.items()
        }
        return SavingCycle(**given)

    def _sources(self, top: dict) -> tuple[list[Source | None], set[str]]:
        """Return all sources, None for each with a mistake, and all names."""
        sources, keys = [], set()
        for section, role in (('channels', CHANNEL), ('actions', ACTION), ('values', VALUE)):
            if section in top:
                for name, node in self.mapping(top[section], section, None).items():
                    if name in RESERVED_NAMES:
                        self.note(
                            node, f'{section} has {name!r}, which has another meaning in '
                            'expressions; expected another name',
                        )  # fmt: skip
                    elif name in keys:
                        self.note(node, f'{section} has {name[:60]!r}, which is used above')
                    keys.add(name)
                    sources.append(self.source(name, node, role))
        return sources, keys

    def robot(self, root) -> RobotFile | None:
        """Read everything; return None if there is a mistake."""
        top = self.mapping(root, 'the file', _KEYS)
        source = self.choice(top['source'], 'source', SOURCES) if 'source' in top else SOURCES[0]
        target = self.choice(top['target'], 'target', targets.TARGETS) if 'target' in top else None
        for key, example in _needed_for(target).items():
            if key not in top and root is not None:
                line = max(root.end_mark.line, 1)
                self.mistakes.append((line, f'the file has no {key!r}; add {example}'))
        step_topic, rate = self._step(top['step']) if 'step' in top else (None, None)
        sources, keys = self._sources(top)
        found = tuple(source for source in sources if source is not None)
        names = [name for source in found for name in source.names]
        for key in ('channels', 'actions'):
            if key in top and isinstance(top[key], yaml.MappingNode) and not top[key].value:
                self.note(top[key], f'no {key}; expected at least one')
        problem = problem_of_names(names)
        if problem:
            self.note(top.get('channels'), f'the channels have {problem}')
        # Names that could not be read count as known, so that each mistake is reported once.
        by_name = dict.fromkeys(keys) | {source.name: source for source in found}
        known = OWN_VALUES | {n for n, s in by_name.items() if s is None or s.names == (n,)}
        reward = self.rule(top.get('reward'), 'reward', known, by_name)
        if isinstance(reward, FieldPath) and not reward.fields:
            self.note(top['reward'], 'reward is a topic without a field')
        episode = (
            self.mapping(top['episode'], 'episode', ('action', 'terminated', 'truncated', 'steps'))
            if 'episode' in top
            else {}
        )
        terminated, truncated = (
            self.rule(episode.get(end), f'episode.{end}', known, by_name)
            for end in ('terminated', 'truncated')
        )
        found = self.with_words(found, (reward, terminated, truncated), top.get('values'))
        action = self.path(episode['action'], 'episode.action') if 'action' in episode else None
        steps = self.number(episode.get('steps'), 'episode.steps', 1, 10**6, is_whole=True)
        discount = self._discount(top['discount']) if 'discount' in top else None
        saving = self._saving(top['saving'], top) if 'saving' in top else None
        if self.mistakes:
            return None
        return RobotFile(
            step_topic, rate, found, reward, terminated, truncated,
            action.topic if action else None, steps, self.types, discount, source,
            target, saving,
        )  # fmt: skip


def _needed_for(target: str | None) -> dict[str, str]:
    """Return the required keys with examples; the target `action` needs no reward."""
    if target != targets.ACTION:
        return _NEEDED
    return {key: example for key, example in _NEEDED.items() if key != 'reward'} | _ACTIONS
