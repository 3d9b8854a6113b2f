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


def level_of_look(significance: float, renewals: float, num_first: int) -> float:
    """Return the level of a look at the newest episodes.

    With any number of earlier looks, the probability that an irrelevant sensor is ever confirmed is
    at most `significance`.

    Parameters
    ----------
    significance : float
        Level of all looks together.
    renewals : float
        How much has come in since the first episode of the task, at least 0: each doubling of the
        number of episodes counts 1, and so does a complete replacement of those held.
    num_first : int
        Number of episodes at the first look, at least 1.

    """
    since_first = max(renewals - math.log2(num_first), 0.0)
    # The integral over all renewals is the significance.
    return significance / (_LOOKS_A_DOUBLING * _PACE * (1 + since_first / _PACE) ** 2)
