# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import direct_lsmi

from cmifs_ros.core import Lsmi
from cmifs_ros.core.samples import StepSamples

WIDTHS = (0.1, 0.5, 2.0)
LAMBDAS = (0.001, 0.1, 10.0)


def estimator(criterion):
    return Lsmi(criterion, widths=WIDTHS, regularizations=LAMBDAS)


def folds_of(size, count=5):
    return np.arange(size) * count // size


def samples(returns, z, folds=None, centers=None):
    size = len(returns)
    folds = folds_of(size) if folds is None else folds
    return StepSamples(returns, z, folds, np.arange(size) if centers is None else centers)


def every(z):
    """Return the subset of all channels."""
    return range(z.shape[1])


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(7, 18),
    channels=st.integers(1, 3),
    discrete=st.booleans(),
    every_sample_a_center=st.booleans(),
)
def test_estimates_equal_the_double_sums(seed, size, channels, discrete, every_sample_a_center):
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(size, channels))
    returns = z[:, 0] + 0.5 * rng.normal(size=size)
    if discrete:  # with ties, and now and then a constant
        z, returns = np.floor(z), np.floor(returns)
    folds = rng.permutation(folds_of(size))
    centers = np.arange(size)
    if not every_sample_a_center:
        centers = np.sort(rng.choice(size, size // 2, replace=False))
    objective, plug_in = direct_lsmi(
        returns, z, folds, centers, widths=WIDTHS, regularizations=LAMBDAS
    )

    step = samples(returns, z, folds, centers)
    (held_out,) = estimator('held_out').estimate(step, [every(z)])
    assert held_out == pytest.approx(-2 * objective - 1, abs=1e-8)
    (fitted,) = estimator('plug_in').estimate(step, [every(z)])
    assert fitted == pytest.approx(plug_in, abs=1e-8)


def test_candidates_estimated_together_equal_those_estimated_alone():
    rng = np.random.default_rng(1)
    step = samples(rng.normal(size=40), rng.normal(size=(40, 6)))
    subsets = [(0,), (1, 2, 3), (0, 4)]
    together = Lsmi().estimate(step, subsets)
    alone = [Lsmi().estimate(step, [subset])[0] for subset in subsets]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-12)


@pytest.mark.parametrize('criterion', ['held_out', 'plug_in'])
def test_order_of_samples_does_not_matter(criterion):
    rng = np.random.default_rng(2)
    z = rng.normal(size=(60, 2))
    returns = z[:, 0] * z[:, 1] + 0.1 * rng.normal(size=60)
    folds = folds_of(60)
    order = rng.permutation(60)
    one = Lsmi(criterion).estimate(samples(returns, z), [every(z)])
    other = Lsmi(criterion).estimate(samples(returns[order], z[order], folds[order]), [every(z)])
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-10)


def gaussian_pair(correlation, size, seed):
    rng = np.random.default_rng(seed)
    x, noise = rng.normal(size=(2, size))
    return x, correlation * x + np.sqrt(1 - correlation**2) * noise


@pytest.mark.parametrize('criterion', ['held_out', 'plug_in'])
def test_independent_data_score_near_zero_and_dependent_data_more_the_more_they_depend(criterion):
    size = 150
    scores = []
    for correlation in (0.0, 0.4, 0.6):
        trials = []
        for seed in range(5):
            x, y = gaussian_pair(correlation, size, seed)
            trials += list(Lsmi(criterion).estimate(samples(y, x[:, None]), [(0,)]))
        scores.append(np.mean(trials))
    assert abs(scores[0]) < 0.03
    assert scores[0] < scores[1] - 0.03 < scores[2] - 0.06


def test_estimate_approaches_the_closed_form_of_the_normal_distribution():
    # Squared-loss MI of a bivariate normal: rho^2 / (1 - rho^2).
    correlation, size = 0.5, 600
    truth = correlation**2 / (1 - correlation**2)
    estimates = []
    for seed in range(5):
        x, y = gaussian_pair(correlation, size, seed)
        centers = np.random.default_rng(seed).choice(size, 100, replace=False)
        step = samples(y, x[:, None], centers=centers)
        estimates += list(Lsmi().estimate(step, [(0,)]))
    assert np.mean(estimates) == pytest.approx(truth, abs=0.1)


@pytest.mark.parametrize(
    ('settings_', 'message'),
    [
        ({'criterion': 'x'}, "criterion is 'x'; expected one of held_out, plug_in"),
        ({'widths': ()}, r'widths is \(\)'),
        ({'regularizations': (0.0,)}, r'regularizations is \(0.0,\)'),
        ({'num_folds': 1}, 'num_folds is 1'),
        ({'num_centers': 0}, 'num_centers is 0'),
    ],
)
def test_bad_settings_are_refused_by_name(settings_, message):
    with pytest.raises(ValueError, match=message):
        Lsmi(**settings_)
