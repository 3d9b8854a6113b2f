# SPDX-License-Identifier: Apache-2.0

"""A selection as JSON: on its topic, in the service's reply, in files.

The contents of a file or message are not trusted: every field is validated.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import Selection, SensorResult
from cmifs_ros.core.statuses import STATUSES
from cmifs_ros.core.targets import TARGETS

from .advice import advice_fields, advice_of
from .json_values import (
    count_of,
    flag_of,
    list_of,
    name_of,
    names_of,
    number_or_none,
    one_of,
    text_of,
)
from .sensor_topics import SensorTopics

#: Version of the fields; it changes when an old reader would misread them.
VERSION = 2
#: Most warnings.
_MAX_WARNINGS = 100


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
        target=one_of(TARGETS, fields['target'], 'target'),
        gamma=number_or_none(fields.get('gamma')),  # Absent in old files.
        predicted_share=number_or_none(fields['predicted_share']),
        predicted_share_of_all=number_or_none(fields['predicted_share_of_all']),
        # Absent in old files.
        predicted_share_of_none=number_or_none(fields.get('predicted_share_of_none')),
        margin=number_or_none(fields['margin']),
        level=number_or_none(fields.get('level')),  # Absent in old files.
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
        one_of(STATUSES, status, 'status')
    if (status is None) != (fields['pvalue'] is None):
        raise ValueError(f'status {status!r} with pvalue {fields["pvalue"]!r}; expected both')
    return SensorResult(
        name=name_of(fields['name']),
        channels=names_of(fields['channels'], MAX_CHANNELS),
        is_selected=flag_of(fields['is_selected']),
        score=float(fields['score']),
        is_constant=flag_of(fields['is_constant']),
        null_band=None if band is None else _three(band),
        pvalue=number_or_none(fields['pvalue']),
        status=status,
        supporting_channels=names_of(fields['supporting_channels'], MAX_CHANNELS),
        redundant_with=names_of(fields['redundant_with'], MAX_CHANNELS),
        stability=number_or_none(fields['stability']),
        effect=None if effect is None else _effect_of(effect),
        why=text_of(fields['why']),
        # Absent in old files.
        together_with=names_of(fields.get('together_with', []), MAX_CHANNELS),
    )


def _effect_of(fields: dict[str, Any]) -> Effect:
    """Return an effect from its share and error, which determine the interval."""
    effect = Effect(float(fields['share']), float(fields['error']))
    if not effect.error >= 0:
        raise ValueError(f'an effect with the error {effect.error}; expected at least 0')
    return effect


def _three(value) -> tuple[float, float, float]:
    low, middle, high = map(float, list_of(value))
    return low, middle, high
