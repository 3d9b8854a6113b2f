# SPDX-License-Identifier: Apache-2.0

"""At which steps a sensor matters: what it adds to the prediction of the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .blas_threads import one_blas_thread
from .samples import scaled
from .selection import Selection
from .targets import Contribution, TargetTest
from .thinning import ThinnedEpisodes


def contribution(
    selection: Selection,
    sensor: str,
    episodes: ThinnedEpisodes,
    channel_names: Sequence[str],
    *,
    action_names: Sequence[str] = (),
    ordered: bool = True,
) -> Contribution:
    """Return what a sensor adds to the prediction by the other selected ones, step by step.

    Parameters
    ----------
    selection : Selection
        By 'conditional_mi'.
    sensor : str
        Its name.
    episodes : ThinnedEpisodes
        Those of the selection.
    channel_names, action_names, ordered
        As of `select`.

    """
    gamma = selection.gamma or 1.0  # Without one, the target is no return.
    places = {name: i for i, name in enumerate(channel_names)}
    samples = scaled(episodes.samples)
    varying = np.ptp(samples.states, axis=0) > 0
    (candidate,) = (s for s in selection.sensors if s.name == sensor)
    others = [s for s in selection.sensors if s.is_selected and s is not candidate]
    with one_blas_thread():
        test = TargetTest(
            samples, selection.target, channel_names, action_names, gamma, ordered=ordered
        )
        return test.added(
            [places[name] for name in candidate.channels if varying[places[name]]],
            [places[name] for other in others for name in other.supporting_channels],
        )
