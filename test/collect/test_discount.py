# SPDX-License-Identifier: Apache-2.0

"""Discounts: a half-life is the time after which half of a reward counts."""

from math import nan

import pytest

from cmifs_ros.collect.discount import Discount, in_words


@pytest.mark.parametrize('step_seconds', [0.02, 0.1, 1.0])
def test_after_a_half_life_half_is_left_however_long_a_step_is(step_seconds):
    gamma = Discount(half_life=20.0).per_step(step_seconds)
    assert gamma ** (20.0 / step_seconds) == pytest.approx(0.5)


def test_a_factor_is_of_the_step_itself():
    assert Discount(gamma=0.9).per_step(nan) == 0.9


@pytest.mark.parametrize(
    ('gamma', 'step_seconds', 'said'),
    [
        (0.95, nan, 'gamma 0.95 per step: a reward counts half after 13.5 steps'),
        (0.5, 0.2, 'gamma 0.5 per step of 0.2 s: a reward counts half after 1 steps, 0.2 s'),
        (1.0, 0.2, 'gamma 1 per step of 0.2 s: late rewards count in full'),
    ],
)
def test_what_a_discount_means_is_told(gamma, step_seconds, said):
    assert in_words(gamma, step_seconds) == said


@pytest.mark.parametrize(
    ('half_life', 'step_seconds', 'said'),
    [
        (2.0, nan, 'but no episode has two steps'),
        (0.001, 1.0, 'discounts a reward to 0 within a step of'),
    ],
)
def test_a_half_life_needs_steps_that_fit(half_life, step_seconds, said):
    with pytest.raises(ValueError, match=said):
        Discount(half_life=half_life).per_step(step_seconds)
