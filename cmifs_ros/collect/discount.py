# SPDX-License-Identifier: Apache-2.0

"""How far ahead the return looks: a discount factor for each step, or a half-life in seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Discount:
    """A discount factor, or a half-life; one of them.

    Attributes
    ----------
    gamma : float or None
        Of each step, above 0 and at most 1.
    half_life : float or None
        Seconds after which a reward counts half.

    """

    gamma: float | None = None
    half_life: float | None = None

    def per_step(self, step_seconds: float) -> float:
        """Return the discount factor of one step.

        >>> Discount(half_life=2.0).per_step(1.0) ** 2
        0.5000000000000001

        Parameters
        ----------
        step_seconds : float
            How long a step lasts; of no meaning to a gamma.

        Raises
        ------
        ValueError
            If that is not known, or a reward counts nothing after a step.

        """
        if self.gamma is not None:
            return self.gamma
        if not step_seconds > 0:
            raise ValueError(
                f'a half-life of {self.half_life:g} s needs the time between steps, of which there '
                'are no two in an episode; expected more steps, or gamma'
            )
        gamma = 0.5 ** (step_seconds / self.half_life)
        if gamma < 1e-6:
            raise ValueError(
                f'a half-life of {self.half_life:g} s leaves nothing of a reward after a step of '
                f'{step_seconds:.3g} s; expected a longer one, or gamma'
            )
        return gamma


def in_words(gamma: float, step_seconds: float) -> str:
    """Return what a discount factor means: after how many steps and seconds half is left.

    >>> in_words(0.95, 0.1)
    'gamma 0.95 a step of 0.1 s: half of a reward counts after 13.5 steps, 1.35 s'

    """
    length = f' of {step_seconds:.3g} s' if math.isfinite(step_seconds) else ''
    if gamma == 1:
        return f'gamma 1 a step{length}: rewards count in full, however late'
    steps = math.log(0.5) / math.log(gamma)
    after = f'{steps:.3g} steps' + (f', {steps * step_seconds:.3g} s' if length else '')
    return f'gamma {gamma:.4g} a step{length}: half of a reward counts after {after}'
