# SPDX-License-Identifier: Apache-2.0

"""The level of a selection that is made again and again while episodes come in.

Each look at the data may find something by chance. So a task's whole life has one level, and each
look spends a part of it (Lan & DeMets, Discrete sequential boundaries for clinical trials, 1983).
"""

from __future__ import annotations

import math

#: By how much each doubling of the data, with any number of looks, is worse than a single look;
#: `make looks` shows it.
_LOOKS_A_DOUBLING = 1.5
#: After so many doublings a look may spend a quarter as much.
_PACE = 4.0


def level_of_look(significance: float, num_seen: int, num_first: int, buffer_size: int) -> float:
    """Return the level of a look at the newest episodes.

    Where the looks before were as many as one likes, something irrelevant is ever confirmed with a
    probability of at most `significance`.

    Parameters
    ----------
    significance : float
        That of all looks together.
    num_seen : int
        Episodes since the task began, also those that have left the buffer.
    num_first : int
        Episodes at the first look, at least 1.
    buffer_size : int
        Greatest number of episodes that are looked at.

    """
    # A doubling of the data is as good as new data; so is a whole new buffer.
    in_buffer = min(num_seen, max(buffer_size, num_first))
    doublings = math.log2(max(in_buffer / num_first, 1.0))
    renewals = doublings + (num_seen - in_buffer) / in_buffer
    # The integral over all renewals is the significance.
    return significance / (_LOOKS_A_DOUBLING * _PACE * (1 + renewals / _PACE) ** 2)
