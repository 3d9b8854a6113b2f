# SPDX-License-Identifier: Apache-2.0

"""The parameters of the selector node, and the parsing of those that are text."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isnan

from cmifs_ros.collect.sensor_groups import groups_by_name
from cmifs_ros.core import CRITERIA, DIRECTIONS
from cmifs_ros.core.selecting import METHODS
from cmifs_ros.core.targets import RETURN, TARGETS
from cmifs_ros.core.words import listed

from . import selected_state_publisher
from .parameters import Spec

#: Least selection_period in seconds, unless it is 0.
LEAST_PERIOD = 0.1

MEGABYTE = 1_000_000

PARAMETERS = (
    Spec('method', 'conditional_mi',
         'conditional_mi: what the return depends on; kdr: what kdr_target depends on.',
         choices=tuple(METHODS)),
    Spec('kdr_target', '',
         'For method kdr: the channels that the reward depends on directly, as in "x,y".'),
    Spec('target', RETURN,
         'What to select for: what the return depends on, what a controller needs, or what the '
         'recorded action depends on. The target of a robot file takes precedence.',
         choices=TARGETS),
    Spec('num_features', 0, 'Number of sensors to select; 0: the confirmed ones.', (0, 10_000)),
    Spec('gamma', 0.95, 'Discount factor of the return, per step.', (1e-6, 1)),
    Spec('half_life', 0.0,
         'Seconds after which a reward counts half; replaces gamma; 0: use gamma.', (0, 1e9)),
    Spec('criterion', 'held_out', 'Estimator of the mutual information.', choices=CRITERIA),
    Spec('standardize', True, 'Replace channels and returns by normal scores.'),
    Spec('direction', 'forward', 'Search: forward selection or backward elimination.',
         choices=DIRECTIONS),
    Spec('sensor_groups', 'auto',
         'Sensors of several channels: "pose=x,y; lidar=l0,l1,l2"; auto: group channels by names '
         'such as scan[0], scan[1] or yaw.sin, yaw.cos.'),
    Spec('min_episodes', 20, 'Episodes needed for a selection.', (2, 100_000)),
    Spec('max_episodes', 100,
         'Episodes kept, at least min_episodes; the oldest are removed first.', (2, 100_000)),
    Spec('forget_outdated', True,
         'When the task has changed, forget the episodes from before, but not the newest '
         'min_episodes.'),
    Spec('max_episode_steps', 1000, 'A longer episode is closed at this step.', (1, 1_000_000)),
    Spec('max_buffer_mb', 256,
         'Memory for the episodes kept, in units of 10^6 bytes; the oldest are removed first.',
         (1, 16_384)),
    Spec('stamp_tolerance', 0.0,
         'Seconds by which the stamps of a state and its reward or action may differ; less than '
         'half a step.', (0, 1e3)),
    Spec('fields', 'position',
         'Fields of the state message to use: "position,velocity,effort" or some of these.'),
    Spec('inf_value', inf,
         'Replaces +inf in a state; inf: by the greatest value of the channel so far.'),
    Spec('max_hold_steps', 0,
         'Consecutive states for which a nan channel keeps its last value.', (0, 1_000_000)),
    Spec('restart_on_new_channels', False,
         'Forget the episodes and start over when the states have other channels.'),
    Spec('episodes_path', '',
         'File that restores the episodes and the selection after a restart; empty: none.',
         read_only=True),
    Spec('selection_period', 30.0, 'Seconds between selections; 0: by service only.',
         (0, 1e6)),
    Spec('selection_timeout', 600.0, 'Seconds after which a selection is cancelled; 0: never.',
         (0, 1e6)),
    Spec('significance', 0.05,
         'Probability that any sensor is ever confirmed when none is informative, over all '
         'selections of a task.', (1e-6, 0.5)),
    Spec('margin', 0.02,
         "Share of the target's variance; a sensor that adds less is dispensable.", (1e-6, 0.999)),
    Spec('max_time_bins', -1,
         'Neighbouring steps of longer episodes are pooled into this many bins; 0 never pools, -1 '
         'chooses from the data.', (-1, 10_000)),
    Spec('random_state', 0, 'Seed of the cross-validation.', (0, 2**31 - 1)),
    Spec('worker_threads', 1, 'Processor cores that a selection may use; kdr always uses one.',
         (1, 64)),
    *selected_state_publisher.PARAMETERS,
)  # fmt: skip

#: The parameters that a selection depends on.
SELECTION_PARAMETERS = {
    'method', 'kdr_target', 'num_features', 'gamma', 'half_life', 'criterion', 'standardize',
    'direction', 'sensor_groups', 'min_episodes', 'max_episodes', 'max_buffer_mb', 'max_time_bins',
    'significance', 'random_state', 'forget_outdated', 'target', 'margin',
}  # fmt: skip

#: Special values; others are a number of bins.
_TIME_BINS = {-1: 'auto', 0: None}

#: Fields of a joint state.
FIELDS = ('position', 'velocity', 'effort')


def check_parameters(values: dict, channel_names: Sequence[str] | None = None) -> None:
    """Raise ValueError if the parameters contradict each other or do not fit the channels."""
    if 0 < values['selection_period'] < LEAST_PERIOD:
        raise ValueError(
            f'selection_period is {values["selection_period"]:g}; expected 0 or at least '
            f'{LEAST_PERIOD} s'
        )
    if isnan(values['inf_value']):
        raise ValueError('inf_value is nan; expected a number or inf')
    parse_fields(values['fields'])
    groups = sensor_groups(values['sensor_groups'], channel_names or ())
    target = []
    if values['kdr_target'] or values['method'] == 'kdr':
        target = parse_kdr_target(values['kdr_target'])
    if channel_names is None:
        return
    grouped = [channel for members in groups.values() for channel in members]
    for parameter, channels in (('sensor_groups', grouped), ('kdr_target', target)):
        unknown = [channel for channel in channels if channel not in channel_names]
        if unknown:
            raise ValueError(
                f'{parameter} names channel {unknown[0]!r}; expected some of '
                f'{listed(channel_names)}'
            )
    num_sensors = len(channel_names) - len(set(grouped)) + len(groups)
    if values['num_features'] > num_sensors:
        raise ValueError(
            f'num_features is {values["num_features"]}; expected at most {num_sensors}, the number '
            'of sensors, or 0'
        )


def parse_fields(text: str) -> list[str]:
    """Return the fields of "position, velocity" as ['position', 'velocity'].

    Raises
    ------
    ValueError
        If a field is empty, repeated or unknown.

    """
    fields = [field.strip() for field in text.split(',')]
    if not set(fields) <= set(FIELDS) or len(set(fields)) < len(fields):
        raise ValueError(f'fields is {text!r}; expected distinct ones of {", ".join(FIELDS)}')
    return fields


def sensor_groups(text: str, channel_names: Sequence[str]) -> dict[str, Sequence[str]]:
    """Return the groups of "pose=x,y; lidar=l0,l1" as {'pose': ['x', 'y'], ...}.

    With "auto" the groups follow from the names of the channels.

    Raises
    ------
    ValueError
        If a part is not of the form name=channel,channel or a name is repeated.

    """
    if text.strip() == 'auto':
        return groups_by_name(channel_names)
    groups: dict[str, list[str]] = {}
    for part in filter(None, map(str.strip, text.split(';'))):
        name, _, members = (piece.strip() for piece in part.partition('='))
        channels = [channel.strip() for channel in members.split(',')]
        if not name or not all(channels) or name in groups:
            raise ValueError(
                f'sensor_groups has {part!r}; expected auto, or distinct names as in '
                '"pose=x,y; arm=a,b"'
            )
        groups[name] = channels
    return groups


def parse_kdr_target(text: str) -> list[str]:
    """Return the channels of "x,y" as ['x', 'y'].

    Raises
    ------
    ValueError
        If a name is empty or repeated.

    """
    channels = [channel.strip() for channel in text.split(',')]
    if not all(channels) or len(set(channels)) < len(channels):
        raise ValueError(
            f'kdr_target is {text!r}; method kdr needs the channels that the reward depends on '
            'directly, distinct, as in "x,y"'
        )
    return channels


def selector_settings(
    values: dict, channel_names: Sequence[str], gamma: float, target: str
) -> dict:
    """Return the constructor parameters of the selector for these channels."""
    settings = {
        'num_features': values['num_features'] or None,
        'direction': values['direction'],
        'groups': sensor_groups(values['sensor_groups'], channel_names),
        'random_state': values['random_state'],
    }
    if values['method'] == 'kdr':
        return settings | {'target': parse_kdr_target(values['kdr_target'])}
    return settings | {
        'target': target,
        'gamma': gamma,
        'criterion': values['criterion'],
        'standardize': values['standardize'],
        'max_time_bins': _TIME_BINS.get(values['max_time_bins'], values['max_time_bins']),
        'significance': values['significance'],
        'margin': values['margin'],
        'n_jobs': values['worker_threads'],
    }
