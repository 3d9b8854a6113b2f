# SPDX-License-Identifier: Apache-2.0

"""What docs/library.md promises of the API."""

import copy
import pickle

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode, KDRSelector

NAMES = ('a', 'b', 'c')


def episodes():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(20, 3, 3))
    return [Episode(s, s[:, 2] + 0.1 * rng.normal(size=3)) for s in states]


@pytest.fixture(scope='module', params=['conditional_mi', 'paper', 'kdr'])
def fitted(request):
    selector = {
        'conditional_mi': ConditionalMISelector(random_state=3, groups={'ab': ['a', 'b']}),
        'paper': ConditionalMISelector.paper(1),
        'kdr': KDRSelector(1, target='c'),
    }[request.param]
    return selector.fit(episodes(), NAMES, progress=lambda fraction: None)


@pytest.mark.parametrize('again', [copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))])
def test_a_fitted_selector_can_be_pickled_and_copied(fitted, again):
    other = again(fitted)
    states = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(other.transform(states), fitted.transform(states))
    assert other.get_feature_names_out().tolist() == fitted.get_feature_names_out().tolist()
    assert repr(other) == repr(fitted)
    other.fit(episodes(), NAMES)
    np.testing.assert_array_equal(other.scores_, fitted.scores_)


def test_a_selector_that_could_not_be_fitted_can_be_pickled_too():
    selector = ConditionalMISelector(3)
    constant = [Episode(np.ones((3, 3)), np.arange(3.0) * i) for i in range(4)]
    with pytest.raises(ValueError, match='num_features is 3'):
        selector.fit(constant, NAMES, progress=lambda fraction: None)
    pickle.dumps(selector)


def test_a_fitted_selector_can_be_cloned(fitted):
    clone = pytest.importorskip('sklearn.base').clone
    other = clone(fitted)
    assert other.get_params() == fitted.get_params()
    assert not hasattr(other, 'ranking_')
    assert hasattr(fitted, 'ranking_')


def test_names_out_are_those_of_the_support_and_others_are_refused(fitted):
    expected = [NAMES[i] for i in fitted.get_support(indices=True)]
    assert fitted.get_feature_names_out().tolist() == expected
    assert fitted.get_feature_names_out(NAMES).tolist() == expected
    assert fitted.get_feature_names_out(np.array(NAMES, dtype=object)).tolist() == expected
    for other in (NAMES[:2], ('a', 'b', 'd')):
        with pytest.raises(
            ValueError, match=r'input_features is a, b.*expected the names .* a, b, c'
        ):
            fitted.get_feature_names_out(other)
