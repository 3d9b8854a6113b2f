# SPDX-License-Identifier: Apache-2.0

"""Selections that tests need, without computing one."""

from dataclasses import replace

from cmifs_ros.core.effect import Effect
from cmifs_ros.core.selection import Selection, SensorResult


def sensor(name, score=0.5, **more):
    """Return a result of a sensor of one channel; with a p-value it was tested."""
    result = SensorResult(name, (name,), is_selected=False, score=score)
    if 'pvalue' in more:
        result = replace(
            result,
            null_band=(-0.01, 0.0, 0.02),
            status='undecided',
            supporting_channels=(name,),
            effect=Effect(0.125, 0.0625),
        )
    return replace(result, **more)


def selection(*sensors, **more):
    """Return a selection of these sensors, whose channels are numbered as they stand."""
    count = sum(len(s.channels) for s in sensors if s.is_selected)
    more = {'margin': 0.02 if any(s.effect for s in sensors) else None} | more
    return Selection(tuple(range(count)), sensors, 25, 60, 1.25, **more)
