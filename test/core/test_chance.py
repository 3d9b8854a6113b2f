# SPDX-License-Identifier: Apache-2.0

"""What chance does to a quadratic statistic, against drawing it."""

import itertools

import numpy as np
import pytest
from scipy import stats

from cmifs_ros.core.chance import (
    pearson3_tail,
    resampled_pvalue,
    sign_flip_pvalue,
    square_pvalues,
)


def statistics_of_all_signs(products):
    signs = itertools.product([-1, 1], repeat=len(products))
    return np.array([np.sum((np.array(s) @ products) ** 2) for s in signs])


def test_sign_flips_have_the_moments_of_all_signs():
    products = np.random.default_rng(0).normal(size=(11, 4)) * np.arange(1, 12)[:, None]
    drawn = statistics_of_all_signs(products)
    for value in np.quantile(drawn, [0.1, 0.5, 0.9, 0.99]):
        expected = stats.pearson3.sf((value - drawn.mean()) / drawn.std(), stats.skew(drawn))
        assert sign_flip_pvalue(value, products) == pytest.approx(expected, rel=1e-9)


def test_sign_flips_are_as_likely_as_their_share_of_all():
    products = np.random.default_rng(1).normal(size=(14, 3))
    drawn = statistics_of_all_signs(products)
    for share in (0.3, 0.1, 0.02):
        value = np.quantile(drawn, 1 - share)
        assert sign_flip_pvalue(value, products) == pytest.approx(share, abs=0.02)


def test_what_no_sign_changes_has_pvalue_1():
    assert sign_flip_pvalue(4.0, np.array([[2.0, 0.0]])) == 1


def test_many_squares_at_once_have_the_pvalue_of_each():
    rng = np.random.default_rng(3)
    products, totals = rng.standard_t(3, size=(11, 4, 5)), 6 * rng.random((4, 5))
    products[:, 0, 0] = 0
    products[1:, 1, 1] = 0
    products[2:, 2, 2] = 0
    found = square_pvalues(totals, products)
    assert found.shape == totals.shape
    for place, total in np.ndenumerate(totals):
        expected = sign_flip_pvalue(total**2, products[(slice(None), *place, None)])
        assert found[place] == pytest.approx(expected, abs=1e-3)
    assert (found[0, 0], found[1, 1]) == (1, 1)


def test_resampled_pvalue_are_those_of_the_law_with_their_moments():
    drawn = np.random.default_rng(2).chisquare(3, size=4000)
    for value in (1.0, 6.0, 12.0):
        pvalue = resampled_pvalue(value, drawn)
        assert pvalue == pytest.approx(stats.chi2.sf(value, 3), abs=0.02)


def test_the_tail_is_scipys():
    for skewness in (0.0, 0.4, 2.0, -1.0):
        for value in (-1.0, 0.5, 4.0):
            expected = stats.pearson3.sf(value, skewness)
            assert pearson3_tail(value, skewness) == pytest.approx(expected, abs=1e-9)
