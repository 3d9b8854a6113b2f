# SPDX-License-Identifier: Apache-2.0

"""A peer for linear dependence: least squares with standard errors clustered by episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from cmifs_ros.core import Episode
from cmifs_ros.core.returns import discounted_returns

GAMMA = 0.95
SIGNIFICANCE = 0.05


def linear_pvalues(episodes: Sequence[Episode]) -> np.ndarray:
    """Return the p-value of each channel's coefficient given all others, shape (v,).

    The return is regressed on all channels, the step and its square; the errors of an episode may
    depend on each other (Liang & Zeger, Longitudinal data analysis using generalized linear models,
    1986).
    """
    returns = np.concatenate([discounted_returns(e.rewards, GAMMA) for e in episodes])
    step = np.concatenate([np.arange(len(e)) for e in episodes])
    channels = np.concatenate([e.states for e in episodes])
    inputs = np.column_stack([channels, np.ones(len(step)), step, step**2])
    inverse = np.linalg.pinv(inputs.T @ inputs)
    coefficients = inverse @ inputs.T @ returns
    starts = np.cumsum([0, *map(len, episodes)])[:-1]
    errors = (returns - inputs @ coefficients)[:, None]
    of_episodes = np.add.reduceat(inputs * errors, starts)
    spreads = np.sqrt(np.diag(inverse @ of_episodes.T @ of_episodes @ inverse))
    ratios = np.abs(coefficients) / np.maximum(spreads, np.finfo(float).tiny)
    return 2 * special.ndtr(-ratios)[: channels.shape[1]]


def linear_selection(episodes: Sequence[Episode], sensors: Sequence[tuple[int, ...]]) -> list[int]:
    """Return the sensors with a significant channel (Bonferroni), smallest p-value first."""
    pvalues = linear_pvalues(episodes) * episodes[0].num_channels
    best = [min(pvalues[list(sensor)]) for sensor in sensors]
    return [int(i) for i in np.argsort(best) if best[i] <= SIGNIFICANCE]
