# SPDX-License-Identifier: Apache-2.0

"""The score of a set of channels: conditional mutual information with the return, given actions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .conditional_mi import ConditionalMI
from .lsmi import Lsmi
from .samples import Samples, normal_scores, split_by_step, standardized
from .search import Criterion
from .targets import ACTION

#: Kernel widths of the default; the paper's grid is wider and finer, with the same results.
WIDTHS = tuple(np.logspace(-1, 1.5, 6))
#: Samples per time bin; neighbouring steps of an episode carry nearly the same information.
_MAX_SAMPLES = 1000


def make_criterion(
    samples: Samples,
    num_bins: int | None,
    *,
    target: str,
    criterion: str,
    standardize: bool,
    num_centers: int | None,
    tuning_window: int,
    random_state: int,
    n_jobs: int,
) -> Criterion:
    """Return a function that scores subsets of the channels.

    Parameters
    ----------
    samples : Samples
    num_bins : int or None
        Greatest number of time bins; None: one for each step.
    target : str
        One of `TARGETS`. For 'action' the score is that of the first action, without a reward.
    criterion, standardize, num_centers, tuning_window, random_state, n_jobs
        As of `ConditionalMISelector`.

    """
    is_default = criterion == 'held_out'
    widths: dict[str, Any] = {'widths': WIDTHS} if is_default else {}
    estimator = Lsmi(criterion=criterion, num_centers=num_centers, **widths)
    actions = samples.actions
    if target == ACTION:
        samples, actions = replace(samples, returns=actions[:, 0]), actions[:, :0]
    if standardize:
        samples = replace(samples, returns=standardized(normal_scores(samples.returns)))
    given = samples.states.shape[1] + np.arange(actions.shape[1])
    steps = split_by_step(
        samples.with_channels(actions),
        max_time_bins=num_bins,
        num_folds=estimator.num_folds,
        num_centers=num_centers,
        random_state=random_state,
        max_samples=_MAX_SAMPLES if is_default else None,
    )
    score = ConditionalMI(steps, estimator, tuning_window=tuning_window, n_jobs=n_jobs)
    return lambda subsets: score([[*subset, *given] for subset in subsets])
