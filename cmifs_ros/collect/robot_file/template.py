# SPDX-License-Identifier: Apache-2.0

"""Write a first robot file from observed topics: every numeric field becomes a channel.

Fields that never changed, or were never a finite number, are commented out with the reason.
Commands are proposed as actions, because the robot does not sense them.
"""

from __future__ import annotations

import json
import keyword
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import groupby

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.core.words import counted

from .field_path import FieldPath
from .model import RESERVED_NAMES, STATUS
from .observed_field import ObservedField
from .observed_fields import MAX_FIELDS, ObservedTopic
from .own_topics import own_topics

#: Last parts of topic names that need the part before them to be clear.
_GENERAL = (
    *('data', 'data_raw', 'raw', 'state', 'status', 'value', 'filtered'),
    *('cmd', 'command', 'commands', 'setpoint'),
)
#: Last parts of the topics of a camera or a lidar that only say what they carry.
_KINDS = re.compile(r'(image|points|cloud)(_\w+)?|compressed(Depth)?')
#: The last part of a topic that tells the robot what to do.
_COMMAND = re.compile(r'(.*_)?(cmd|commands?|setpoints?)(_.*)?|goal(_pose)?')
#: Rates of steps to propose, in Hz, and by how much one may exceed a measured rate.
_RATES, _SLACK = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1), 1.2
#: Says what nodes and recorders need for a simulated robot.
USE_SIM_TIME = '# Time is simulated: start the nodes with use_sim_time:=true; record /clock, too.'
_OF_ROS = ('/rosout', '/parameter_events', '/clock')


def robot_file_of_topics(
    title: str, heard: Iterable[ObservedTopic], is_simulated: bool = False
) -> str:
    """Return the text of a robot file with all channels of some topics.

    Parameters
    ----------
    title : str
        Where they were observed.
    heard : iterable of ObservedTopic
    is_simulated : bool, optional
        Whether their time is that of /clock.

    Raises
    ------
    RecordingError
        If no topic has a readable message.

    """
    heard = sorted((one for one in heard), key=lambda one: one.topic)
    own = own_topics(one.trace for one in heard)
    found: list[tuple[ObservedTopic, ObservedField]] = []
    without: list[str] = []
    for one in heard:
        fields = list((one.fields or {}).values())
        telling = [field for field in fields if not field.is_text or field.words]
        if not is_of_robot(one.topic):
            continue
        if one.fields is None:
            without.append(f'{one.topic}{one.problem}')
        elif one.topic in own:
            without.append(f'{one.topic}: {own[one.topic]}; not a sensor')
        elif telling:
            found += [(one, field) for field in telling]
        elif fields:
            without += [f'{one.topic} is text: {fields[0].shown_words}']
        else:
            without.append(f'{one.topic} ({one.kind}) has no numeric field')
        if len(fields) == MAX_FIELDS:
            without.append(f'{one.topic} has more than {counted(MAX_FIELDS, "field")}')
    names = _names([field.path for _, field in found])
    lines: list[str] = []
    commands: list[str] = []
    for name, (one, field) in zip(names, found, strict=True):
        line = _channel(name, field, one, _max_age(one.period(field)))
        (commands if _COMMAND.fullmatch(one.topic.rpartition('/')[2]) else lines).append(line)
    if all(one.fields is None for one in heard):
        raise RecordingError(
            f'{title} has no readable message, so there is no channel'
            + ''.join(f'; {what}' for what in without[:8])
        )
    ros_actions = [one.topic.removesuffix(STATUS) for one in heard if one.topic.endswith(STATUS)]
    lines += [f'# {what}' for what in without]
    rates = {one.topic: one.rate for one, _ in found if one.rate}
    steps = ([USE_SIM_TIME] if is_simulated else []) + _steps(rates)
    return _text(title, lines, commands, ros_actions, steps)


def _channel(name: str, field: ObservedField, heard: ObservedTopic, age: str) -> str:
    """Return the line for a channel."""
    path, options = json.dumps(field.text), field.options + age
    one_hot = f'{name}: {{path: {path}{options}, one_hot: [%s]}}'
    if field.words:
        return f'  # {one_hot % ", ".join(field.words)}  # text; values seen'
    line = f'{name}: ' + (f'{{path: {path}{options}}}' if options else path)
    if field.why_not:
        unseen, count = heard.num_unseen, heard.count
        seen = f', in {count - unseen} of {count} messages' if unseen else ''
        return f'  # {line}  # {field.why_not}{seen}'
    if field.categories:
        line += f'  # if {field.categories} are categories: '
        line += (one_hot % field.categories).removeprefix(f'{name}: ')
    return f'  {line}'


def is_of_robot(topic: str) -> bool:
    """Return whether a topic may be a sensor's: neither one of ROS itself nor of an action."""
    return topic not in _OF_ROS and '/_action/' not in topic


def _max_age(period: float) -> str:
    """Return the `max_age` option for a field that comes less often than twice a second."""
    if math.isinf(period):
        return ', max_age: .inf'
    return f', max_age: {math.ceil(3 * period)}.0' if period > 0.5 else ''


def _names(paths: list[FieldPath]) -> list[str]:
    """Return a name for each: its topic and as many last parts as distinguish it from the others.

    Without the topic, names such as `voltage` or `linear_x` would not say where they come from.
    """
    alternatives = [_alternatives(path) for path in paths]
    counts = Counter(name for names in alternatives for name in set(names))
    taken = set(RESERVED_NAMES)
    found: list[str] = []
    for names in alternatives:
        unique = [n for n in names if counts[n] == 1 and n not in taken]
        name = unique[0] if unique else names[-1]
        number = 2
        while name in taken:
            name, number = f'{names[-1]}_{number}', number + 1
        taken.add(name)
        found.append(name)
    return found


def _alternatives(path: FieldPath) -> list[str]:
    """Return possible names of a field, shortest first."""
    spaces = [_word(part) for part in path.topic.strip('/').split('/')]
    while not path.fields and len(spaces) > 1 and _KINDS.fullmatch(spaces[-1]):
        del spaces[-1]
    if spaces[-1] in _GENERAL and len(spaces) > 1:
        spaces[-2:] = ['_'.join(spaces[-2:])]
    parts: list[str] = []
    for part in path.fields:
        if part[0] == '{':  # The entry's name is more informative than that of its array.
            parts[-1] = _word(part[1:-1])
        elif part[0] == '[':
            parts[-1] += f'_{part[1:-1]}'
        else:
            parts.append(_word(part))
    is_of_entry = len(path.fields) > 1 and path.fields[-2][0] == '{'
    if path.fields == ('data',) or (is_of_entry and parts[-1] == 'value'):
        del parts[-1]
    parts = [part for part, _ in groupby(parts)]  # Not pose_pose.
    names = [] if parts else [spaces[-1:]]
    names += [[spaces[-1], *parts[-length:]] for length in range(1, len(parts) + 1)]
    names += [spaces[-length:] + parts for length in range(2, len(spaces) + 1)]
    texts = ['_'.join(part for part, _ in groupby(name)) for name in names]
    return [text for text in texts if text.isidentifier() and not keyword.iskeyword(text)] or [
        f'channel_{texts[-1]}'
    ]


def _steps(rates: Mapping[str, float]) -> list[str]:
    """Return the lines about steps: the rates of the topics in Hz, and a rate that fits."""
    if not rates:
        return [f'step: {{rate: {_RATES[0]}}}']
    slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
    # Steps faster than any topic would only repeat its values.
    fits = next((rate for rate in _RATES if rate <= _SLACK * rates[fast]), _RATES[-1])
    slowest = '' if slow == fast else f'{rates[slow]:.2g} Hz ({slow}) to '
    return [
        f'# Seen: {slowest}{rates[fast]:.3g} Hz ({fast}).',
        '# Between its messages a slow topic keeps its value until max_age; of a fast one the',
        '# newest message counts, or all of them with `over`.',
        f'step: {{rate: {fits}}}',
    ]


def _word(text: str) -> str:
    return re.sub(r'\W+', '_', text, flags=re.ASCII).strip('_')


def _text(
    title: str,
    channels: list[str],
    commands: list[str],
    ros_actions: list[str],
    steps: list[str],
) -> str:
    lines = [
        f'# Written by make_robot_file from {json.dumps(title)[1:-1]}.',
        '# Complete what is marked TODO. Remove channels that cannot matter: more channels need',
        '# more episodes. Fields that never changed, or were never a number, are commented out:',
        '# was the robot at its task?',
        '',
        '# TODO: steps per second, or a step at each message of a topic: {topic: /odom}.',
        *steps,
        '',
        'channels:',
        *channels,
        '',
        '# TODO: what the robot does, if recorded. Sensors are tested given the actions, which are',
        '# never selected. `target: decision` and `target: action` need them.',
        '# actions:',
        *(f'# {command}' for command in commands or ['  drive: "/cmd_vel.linear.x"']),
        '',
        '# TODO: the reward, from channel values; before(name) is the value at the previous step.',
        '# Values that are not sensors, such as the distance to the goal, belong under `values:`.',
        '# reward: "before(distance) - distance"',
        '',
        '# TODO: when an episode ends: after a number of steps, with an action, or on a condition:',
    ]
    lines += [f'# episode: {{action: {action}}}' for action in ros_actions or ['/navigate_to_pose']]
    lines += ['# episode: {terminated: "distance < 0.1", steps: 300}', 'episode: {steps: 25}']
    return '\n'.join(lines) + '\n'
