# SPDX-License-Identifier: Apache-2.0

"""The significance level of a selection that is repeated while episodes arrive.

Each look at the data may find something by chance. So all looks at a task share one level, and each
look spends a part of it (Lan & DeMets, Discrete sequential boundaries for clinical trials, 1983).
"""

from __future__ import annotations

import math

#: Error rate over a doubling of the data, with any number of looks, relative to a single look; see
#: `make looks`.
_LOOKS_A_DOUBLING = 1.5
#: Number of doublings after which a look spends a quarter as much.
_PACE = 2.0


def level_of_look(significance: float, num_seen: int, num_first: int, buffer_size: int) -> float:
    """Return the level of a look at the newest episodes.

    With any number of earlier looks, the probability that an irrelevant sensor is ever confirmed is
    at most `significance`.

    Parameters
    ----------
    significance : float
        Level of all looks together.
    num_seen : int
        Number of episodes since the task began, including those removed from the buffer.
    num_first : int
        Number of episodes at the first look, at least 1.
    buffer_size : int
        Greatest number of episodes in a look.

    """
    # A doubling of the data counts as new data; so does a completely new buffer.
    in_buffer = min(num_seen, max(buffer_size, num_first))
    doublings = math.log2(max(in_buffer / num_first, 1.0))
    renewals = doublings + (num_seen - in_buffer) / in_buffer
    # The integral over all renewals is the significance.
    return significance / (_LOOKS_A_DOUBLING * _PACE * (1 + renewals / _PACE) ** 2)
