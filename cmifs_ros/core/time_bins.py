# SPDX-License-Identifier: Apache-2.0

"""Choose the number of time bins: neighbouring steps are pooled if that raises the score."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .search import Criterion, Sensor, forward_selection

#: Number of bins if steps are not pooled into a single one.
MOST_BINS = 32
#: Factor and margin by which the score must be greater to pool all steps.
_POOLING_FACTOR, _POOLING_MARGIN = 1.5, 0.1
#: Number of sensors whose joint scores are compared.
_NUM_TRIED = 2


def choose_time_bins(
    make_criterion: Callable[[int], Criterion], units: Sequence[Sensor]
) -> tuple[int, Criterion]:
    """Return 1 or `MOST_BINS`, whichever has the greater score, and the criterion.

    Parameters
    ----------
    make_criterion : callable
        Returns the criterion for a number of bins.
    units : sequence of tuple of int
        Channels that are likely to be informative.

    """
    tried = min(_NUM_TRIED, len(units))
    criteria = {bins: make_criterion(bins) for bins in (1, MOST_BINS)}
    best = {
        bins: max(forward_selection(criterion, units, tried)[1], default=0)
        for bins, criterion in criteria.items()
    }
    pools = best[1] > _POOLING_FACTOR * max(best[MOST_BINS], 0.0) + _POOLING_MARGIN
    bins = 1 if pools else MOST_BINS
    return bins, criteria[bins]
