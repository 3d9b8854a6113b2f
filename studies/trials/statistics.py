# SPDX-License-Identifier: Apache-2.0

"""Statistics over trials for tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def rank_sum(ranking: Sequence[int], relevant: Sequence[int], num_channels: int) -> float:
    """Return the sum of the ranks, from 1, of the relevant channels.

    A channel that was not ranked counts as if the rest followed in random order.
    """
    unranked = (len(ranking) + 1 + num_channels) / 2
    places = {channel: place for place, channel in enumerate(ranking, start=1)}
    return sum(places.get(channel, unranked) for channel in relevant)


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Return mean and standard error; a single value has an error of 0."""
    values = np.array(values, dtype=float)
    if len(values) == 1:
        return float(values[0]), 0.0
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
