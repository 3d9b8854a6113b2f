# SPDX-License-Identifier: Apache-2.0

"""The topics of channels and their traffic, passed from the sampler to the selector."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from cmifs_ros.core.channel_names import MAX_CHANNELS

from .json_values import name_of
from .traffic import Rate


class SensorTopics(NamedTuple):
    """The topics of a robot file.

    Attributes
    ----------
    topics : mapping of str to str
        The topic of each channel.
    rates : mapping of str to Rate
        By topic, as received.
    needed : tuple of str
        Topics needed for actions, steps, the reward or the ends of episodes.

    """

    topics: Mapping[str, str]
    rates: Mapping[str, Rate]
    needed: tuple[str, ...]


def topic_fields(found: SensorTopics) -> dict[str, Any]:
    """Return sensor topics as a dict for JSON; docs/interface.md lists the fields."""
    return {
        'channels': dict(found.topics),
        'rates': rate_fields(found.rates),
        'needed': list(found.needed),
    }


def rate_fields(rates: Mapping[str, Rate]) -> dict[str, dict[str, float]]:
    """Return rates by topic as a dict for JSON."""
    return {
        topic: {'messages_per_s': _short(rate.messages), 'bytes_per_s': _short(rate.bytes)}
        for topic, rate in rates.items()
    }


def sensor_topics_of(fields: dict[str, Any]) -> SensorTopics:
    """Return the sensor topics in a value from JSON, which is not trusted.

    Raises
    ------
    ValueError, TypeError, KeyError, AttributeError
        If a field is missing or invalid.

    """
    topics = {name_of(channel): name_of(topic) for channel, topic in fields['channels'].items()}
    rates = {
        name_of(topic): Rate(_rate(rate['messages_per_s']), _rate(rate['bytes_per_s']))
        for topic, rate in fields['rates'].items()
    }
    needed = tuple(name_of(topic) for topic in fields['needed'])
    count = max(len(topics), len(rates), len(needed))
    if count > MAX_CHANNELS:
        raise ValueError(f'{count} channels or topics; expected at most {MAX_CHANNELS}')
    return SensorTopics(topics, rates, needed)


def _short(number: float) -> float:
    return float(f'{number:.3g}')


def _rate(value) -> float:
    try:
        rate = float(value)
    except OverflowError:  # An integer of hundreds of digits.
        rate = math.inf
    if not 0 <= rate < math.inf:
        raise ValueError(f'a rate of {rate}; expected a finite number of 0 or more')
    return rate
