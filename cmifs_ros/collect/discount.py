# SPDX-License-Identifier: Apache-2.0

"""The discount of the return: a factor per step, or a half-life in seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Discount:
    """Either a discount factor or a half-life.

    Attributes
    ----------
    gamma : float or None
        Factor per step, 0 < gamma <= 1.
    half_life : float or None
        Seconds after which a reward counts half.

    """

    gamma: float | None = None
    half_life: float | None = None

    def per_step(self, step_seconds: float) -> float:
        """Return the discount factor per step.

        >>> Discount(half_life=2.0).per_step(1.0) ** 2
        0.5000000000000001

        Parameters
        ----------
        step_seconds : float
            Duration of a step; only a half-life needs it.

        Raises
        ------
        ValueError
            If the duration is unknown, or a reward would count nothing after one step.

        """
        if self.gamma is not None:
            return self.gamma
        if not step_seconds > 0:
            raise ValueError(
                f'a half-life of {self.half_life:g} s needs the time between steps, but no episode '
                'has two steps; expected longer episodes, or gamma'
            )
        gamma = 0.5 ** (step_seconds / self.half_life)
        if gamma < 1e-6:
            raise ValueError(
                f'a half-life of {self.half_life:g} s discounts a reward to 0 within a step of '
                f'{step_seconds:.3g} s; expected a longer one, or gamma'
            )
        return gamma


def in_words(gamma: float, step_seconds: float) -> str:
    """Explain a discount factor: after how many steps and seconds a reward counts half.

    >>> in_words(0.95, 0.1)
    'gamma 0.95 per step of 0.1 s: a reward counts half after 13.5 steps, 1.35 s'

    """
    length = f' of {step_seconds:.3g} s' if math.isfinite(step_seconds) else ''
    if gamma == 1:
        return f'gamma 1 per step{length}: late rewards count in full'
    steps = math.log(0.5) / math.log(gamma)
    after = f'{steps:.3g} steps' + (f', {steps * step_seconds:.3g} s' if length else '')
    return f'gamma {gamma:.4g} per step{length}: a reward counts half after {after}'
