# SPDX-License-Identifier: Apache-2.0

"""A selection as JSON: on its topic, in the service's reply, in files.

The contents of a file or message are not trusted: every field is validated.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from cmifs_ros.core.channel_names import MAX_CHANNELS, MAX_NAME_LENGTH
from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import Selection, SensorResult
from cmifs_ros.core.statuses import STATUSES
from cmifs_ros.core.targets import TARGETS

from .advice import advice_fields, advice_of
from .sensor_topics import SensorTopics

#: Version of the fields; it changes when an old reader would misread them.
VERSION = 2
#: Longest `why` or warning, in characters; most warnings.
_MAX_TEXT, _MAX_WARNINGS = 1000, 100


def fields_of(selection: Selection, topics: SensorTopics | None = None) -> dict[str, Any]:
    """Return a selection as a dict for JSON; docs/interface.md lists the fields.

    The means and spreads of the data are left out. The advice is about topics if these are known.
    """
    return {
        'version': VERSION,
        'number': selection.number,
        'indices': selection.indices,
        'names': selection.names,
        'ranking': selection.ranking,
        'scores': selection.scores,
        'sensors': [_sensor_fields(sensor) for sensor in selection.sensors],
        'episodes': selection.episodes,
        'steps': selection.steps,
        'seconds': selection.seconds,
        'outdated': selection.outdated,
        'target': selection.target,
        'gamma': selection.gamma,
        'predicted_share': selection.predicted_share,
        'predicted_share_of_all': selection.predicted_share_of_all,
        'predicted_share_of_none': selection.predicted_share_of_none,
        'margin': selection.margin,
        'level': selection.level,
        'warnings': selection.warnings,
        'losses': selection.losses,
        'doubt': selection.doubt,
        'advice': advice_fields(advice_of(selection, *(topics or ()))),
    }


def _sensor_fields(sensor: SensorResult) -> dict[str, Any]:
    fields = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)}
    effect = sensor.effect
    if effect is not None:
        fields['effect'] = effect._asdict() | {'low': effect.low, 'high': effect.high}
    return fields


def selection_of(fields: dict[str, Any]) -> Selection:
    """Return the selection in a dict from JSON; `means` and `spreads` may be missing.

    Raises
    ------
    ValueError, TypeError, KeyError
        If a field is missing or invalid.

    """
    if fields['version'] != VERSION:
        raise ValueError(f'a selection of version {fields["version"]!r}; expected {VERSION}')
    sensors = tuple(_sensor_of(sensor) for sensor in list_of(fields['sensors']))
    selection = Selection(
        indices=tuple(count_of(index) for index in list_of(fields['indices'])),
        sensors=sensors,
        episodes=count_of(fields['episodes']),
        steps=count_of(fields['steps']),
        seconds=float(fields['seconds']),
        means=tuple(float(mean) for mean in list_of(fields.get('means', []))),
        spreads=tuple(float(spread) for spread in list_of(fields.get('spreads', []))),
        outdated=count_of(fields['outdated']),
        number=count_of(fields['number']),
        target=_one_of(TARGETS, fields['target'], 'target'),
        gamma=_number_or_none(fields.get('gamma')),  # Absent in old files.
        predicted_share=_number_or_none(fields['predicted_share']),
        predicted_share_of_all=_number_or_none(fields['predicted_share_of_all']),
        # Absent in old files.
        predicted_share_of_none=_number_or_none(fields.get('predicted_share_of_none')),
        margin=_number_or_none(fields['margin']),
        level=_number_or_none(fields.get('level')),  # Absent in old files.
        warnings=tuple(text_of(text) for text in list_of(fields['warnings'])),
        losses=text_of(fields.get('losses', '')),  # Absent in old files, as is doubt.
        doubt=text_of(fields.get('doubt', '')),
    )
    if len(selection.warnings) > _MAX_WARNINGS:
        raise ValueError(f'{len(selection.warnings)} warnings; expected at most {_MAX_WARNINGS}')
    if selection.margin is not None and not 0 < selection.margin < 1:
        raise ValueError(f'margin {selection.margin}; expected 0 < margin < 1, or null')
    names_of(list(selection.ranking), MAX_CHANNELS)
    names_of([name for sensor in sensors for name in sensor.channels], MAX_CHANNELS)
    if len(selection.means) != len(selection.spreads):
        raise ValueError(f'{len(selection.means)} means for {len(selection.spreads)} spreads')
    if len(selection.indices) != len(selection.names):
        raise ValueError(
            f'{len(selection.indices)} indices for {len(selection.names)} selected channels'
        )
    if max(selection.indices, default=0) >= MAX_CHANNELS:
        raise ValueError(f'index {max(selection.indices)}; expected less than {MAX_CHANNELS}')
    return selection


def _sensor_of(fields: dict[str, Any]) -> SensorResult:
    status, band, effect = fields['status'], fields['null_band'], fields['effect']
    if status is not None:
        _one_of(STATUSES, status, 'status')
    if (status is None) != (fields['pvalue'] is None):
        raise ValueError(f'status {status!r} with pvalue {fields["pvalue"]!r}; expected both')
    (name,) = names_of([fields['name']], 1)
    return SensorResult(
        name=name,
        channels=names_of(fields['channels'], MAX_CHANNELS),
        is_selected=_flag(fields['is_selected']),
        score=float(fields['score']),
        is_constant=_flag(fields['is_constant']),
        null_band=None if band is None else _three(band),
        pvalue=_number_or_none(fields['pvalue']),
        status=status,
        supporting_channels=names_of(fields['supporting_channels'], MAX_CHANNELS),
        redundant_with=names_of(fields['redundant_with'], MAX_CHANNELS),
        stability=_number_or_none(fields['stability']),
        effect=None if effect is None else _effect_of(effect),
        why=text_of(fields['why']),
        together_with=names_of(fields.get('together_with', []), MAX_CHANNELS),  # As level.
    )


def _flag(value) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f'{value!r} instead of true or false')
    return value


def _number_or_none(value) -> float | None:
    return None if value is None else float(value)


def _one_of(expected: tuple[str, ...], value, what: str) -> str:
    if value not in expected:
        raise ValueError(f'{what} {value!r:.40}; expected one of {", ".join(expected)}')
    return value


def _effect_of(fields: dict[str, Any]) -> Effect:
    """Return an effect from its share and error, which determine the interval."""
    effect = Effect(float(fields['share']), float(fields['error']))
    if not effect.error >= 0:
        raise ValueError(f'an effect with the error {effect.error}; expected at least 0')
    return effect


def text_of(value) -> str:
    """Return a value that must be a text of limited length; otherwise raise ValueError."""
    if not isinstance(value, str) or len(value) > _MAX_TEXT:
        raise ValueError(f'{value!r:.40} instead of a text of at most {_MAX_TEXT} characters')
    value.encode()  # UnicodeEncodeError, a ValueError: messages and logs have no surrogates.
    return value


def _three(value) -> tuple[float, float, float]:
    low, middle, high = map(float, list_of(value))
    return low, middle, high


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


def names_of(value, most: int) -> tuple[str, ...]:
    """Return a value that must be a list of distinct names; otherwise raise ValueError."""
    names = tuple(list_of(value))
    if not all(isinstance(name, str) and 0 < len(name) <= MAX_NAME_LENGTH for name in names):
        raise ValueError(f'a name that is not a text of 1 to {MAX_NAME_LENGTH} characters')
    ''.join(names).encode()  # As in `text_of`.
    if len(names) > most or len(set(names)) < len(names):
        raise ValueError(f'{len(names)} names; expected at most {most}, all distinct')
    return names
