"""A selection as JSON: on its topic, in the service's reply, in files.

What a file or a message says may be anything, so nothing of it is believed.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from cmifs_ros.core.channel_names import MAX_CHANNELS, MAX_NAME_LENGTH
from cmifs_ros.core.selection import Effect, Selection, SensorResult
from cmifs_ros.core.statuses import STATUSES

#: Of the fields; it changes where an old reader would misread them.
VERSION = 1


def fields_of(selection: Selection) -> dict[str, Any]:
    """Return what JSON says of a selection; docs/interface.md lists it.

    The means and spreads of the data are not in it.
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
    }


def _sensor_fields(sensor: SensorResult) -> dict[str, Any]:
    effect = sensor.effect and sensor.effect._asdict()
    return {field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)} | {
        'effect': effect
    }


def selection_of(fields: dict[str, Any]) -> Selection:
    """Return the selection that JSON says; its `means` and `spreads` may be missing.

    Raises
    ------
    ValueError, TypeError, KeyError
        If a field is missing or cannot be one.

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
    )
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
    if status not in (None, *STATUSES):
        raise ValueError(f'status {status!r}; expected one of {", ".join(STATUSES)}, or null')
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
        effect=None if effect is None else Effect(*_three([effect[k] for k in Effect._fields])),
        why=_text(fields['why']),
    )


def _flag(value) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f'{value!r} in place of true or false')
    return value


def _number_or_none(value) -> float | None:
    return None if value is None else float(value)


def _text(value) -> str:
    if not isinstance(value, str) or len(value) > MAX_NAME_LENGTH:
        raise ValueError(
            f'{value!r:.40} in place of a text of at most {MAX_NAME_LENGTH} characters'
        )
    return value


def _three(value) -> tuple[float, float, float]:
    low, middle, high = map(float, list_of(value))
    return low, middle, high


def list_of(value) -> list:
    """Return a value that has to be a list; else raise TypeError."""
    if not isinstance(value, list):
        raise TypeError(f'{type(value).__name__} in place of a list')
    return value


def count_of(value, least: int = 0) -> int:
    """Return a value that has to be an integer of at least `least`; else raise ValueError."""
    if type(value) is not int or value < least:
        raise ValueError(f'{value!r} in place of an integer of at least {least}')
    return value


def names_of(value, most: int) -> tuple[str, ...]:
    """Return a value that has to be a list of different names; else raise ValueError."""
    names = tuple(list_of(value))
    if not all(isinstance(name, str) and 0 < len(name) <= MAX_NAME_LENGTH for name in names):
        raise ValueError(f'a name that is no text of 1 to {MAX_NAME_LENGTH} characters')
    if len(names) > most or len(set(names)) < len(names):
        raise ValueError(f'{len(names)} names; expected at most {most}, all different')
    return names
