# SPDX-License-Identifier: Apache-2.0

"""Effect sizes against shares that are known in closed form."""

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.core.effect import Effect

NUM_EPISODES, NUM_STEPS = 60, 12


def returns_of(seed, *weights, noise=1.0):
    """Return states and rewards; with gamma near 0 the return is the reward."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(NUM_EPISODES, NUM_STEPS, 4))
    rewards = states[..., : len(weights)] @ np.array(weights)
    return states, rewards + noise * rng.normal(size=rewards.shape)


def effects(data, **settings):
    selector = ConditionalMISelector(gamma=1e-9, **settings).fit(data)
    names = [selector.sensor_names_[i] for i in selector.ranking_]
    return dict(zip(names, selector.effects_, strict=True)), selector


def test_the_share_of_a_linear_sensor_is_that_of_its_variance():
    found = [effects(returns_of(seed, 0.8, 0.4))[0] for seed in range(8)]
    total = 0.8**2 + 0.4**2 + 1
    for name, expected in (('x0', 0.8**2 / total), ('x1', 0.4**2 / total), ('x3', 0.0)):
        shares = [of[name].share for of in found]
        assert np.mean(shares) == pytest.approx(expected, rel=0.1, abs=0.01)
        covered = [of[name].low <= expected <= of[name].high for of in found]
        assert np.mean(covered) >= 0.75


def test_a_copy_adds_nothing_and_is_dispensable():
    states, rewards = returns_of(0, 1.0)
    states[..., 2] = 3 * states[..., 0] - 1
    found, selector = effects((states, rewards))
    assert selector.num_features_ == 1
    other = next(name for name in ('x0', 'x2') if name not in selector.get_feature_names_out())
    assert found[other] == Effect(0.0, 0.0)
    assert selector.statuses_[selector.ranking_.tolist().index(int(other[1]))] == 'dispensable'


def test_noise_is_dispensable_and_what_is_confirmed_is_not():
    statuses = [effects(returns_of(seed, 0.6))[1].statuses_ for seed in range(6)]
    assert all(of[0] == 'confirmed' for of in statuses)
    rest = [status for of in statuses for status in of[1:]]
    assert rest.count('dispensable') >= 0.8 * len(rest)


def test_a_wide_margin_needs_less_evidence():
    data = returns_of(1, 0.0)
    assert 'dispensable' not in effects(data, margin=1e-9)[1].statuses_
    assert effects(data, margin=0.9)[1].statuses_ == ['dispensable'] * 4


@pytest.mark.parametrize('count', [2, 6, 19])
def test_from_few_episodes_nothing_is_dispensable(count):
    rng = np.random.default_rng(count)
    states = rng.normal(size=(count, 30, 5))
    states[..., 4] = 1.0
    selector = ConditionalMISelector(margin=0.9).fit((states, states[..., 0]))
    assert 'dispensable' not in selector.statuses_


def test_what_matters_only_as_a_product_is_not_dispensable():
    # One of many pairs, so weak that the pair is not found, but above the margin.
    for seed in range(4):
        rng = np.random.default_rng(seed)
        states = rng.normal(size=(NUM_EPISODES, NUM_STEPS, 4))
        rewards = 0.5 * states[..., 0] * states[..., 1] + rng.normal(size=states.shape[:2])
        selector = effects((states, rewards), num_features=1)[1]
        status = dict(zip(selector.ranking_.tolist(), selector.statuses_, strict=True))
        assert 'dispensable' not in (status.get(0), status.get(1))


def test_what_the_selected_predict_is_told_beside_what_all_do():
    selector = effects(returns_of(2, 0.8))[1]
    assert selector.predicted_share_ == pytest.approx(0.64 / 1.64, abs=0.06)
    assert selector.predicted_share_of_all_ <= selector.predicted_share_ + 0.02


def test_what_is_confirmed_at_the_usual_level_is_not_dispensable_at_a_stricter_one():
    data = returns_of(0, 0.3)
    usual = effects(data, margin=0.9)[1]
    assert (usual.ranking_[0], usual.num_features_) == (0, 1)
    stricter = effects(data, margin=0.9, significance=usual.pvalues_[0] / 2)[1]
    statuses = dict(zip(stricter.ranking_.tolist(), stricter.statuses_, strict=True))
    assert statuses == {0: 'undecided', 1: 'dispensable', 2: 'dispensable', 3: 'dispensable'}
