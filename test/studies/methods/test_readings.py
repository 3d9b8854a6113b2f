# SPDX-License-Identifier: Apache-2.0

"""Other readings of the paper: they differ from ours in what they say, and in nothing else."""

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode, KDRSelector
from cmifs_ros.sim import rollout
from studies.methods.direct_port import rank_directly
from studies.methods.readings import ReadKDR, rank_read


def small(scenario, seed):
    return [Episode(e.states[8:12, :5], e.rewards[8:12]) for e in rollout(scenario, 15, seed)]


@pytest.mark.parametrize(
    ('name', 'criterion', 'standardize'),
    [
        ('paper_standardized', 'plug_in', True),
        ('paper_held_out', 'held_out', False),
        ('paper_held_out_standardized', 'held_out', True),
    ],
)
def test_estimates_are_those_of_the_port(name, criterion, standardize):
    episodes = small('with_gravel', 1)
    ranking, scores = rank_read(name, episodes, (0,), 1, 5)
    expected = rank_directly(
        episodes,
        criterion=criterion,
        standardize=standardize,
        max_time_bins=None,
        tuning_window=0,
        num_centers=None,
        random_state=1,
    )
    assert ranking == expected[0]
    np.testing.assert_allclose(scores, expected[1], rtol=0, atol=1e-8)


def test_the_programs_estimate_is_half_of_h_alpha_less_a_half():
    # With one sample and its copies H = h = 1, so alpha is 1 / (1 + lambda).
    episodes = [Episode(np.ones((1, 2)), np.ones(1))] * 6
    _, scores = rank_read('paper_program', episodes, (0,), 0, 1)
    assert scores == [pytest.approx(0.5 / (1 + 0.001 / 6) - 0.5, abs=1e-9)]


def test_kdr_as_we_read_it_is_our_kdr():
    episodes = small('without_gravel', 2)
    ours = KDRSelector(target=0).fit(episodes)
    subsets = [ours.ranking_[:k].tolist() for k in (1, 2, 3)]
    same = ReadKDR(own_widths=False, scaled=False).criterion(episodes, (0,), 0)(subsets)
    np.testing.assert_allclose(np.diff(same), np.diff(ours.scores_[:3]), rtol=0, atol=1e-9)


@pytest.mark.parametrize('name', ['kdr_own_widths', 'kdr_scaled', 'paper_program'])
def test_readings_rank_every_channel_once(name):
    ranking, _ = rank_read(name, small('with_gravel', 3), (0,), 0, 5)
    assert sorted(ranking) == list(range(5))


def test_the_paper_setting_is_the_one_the_readings_start_from():
    episodes = small('with_gravel', 4)
    ours = ConditionalMISelector.paper().fit(episodes)
    expected = rank_directly(
        episodes,
        criterion='plug_in',
        standardize=False,
        max_time_bins=None,
        tuning_window=0,
        num_centers=None,
    )
    assert ours.ranking_.tolist() == expected[0]
    np.testing.assert_allclose(ours.scores_, expected[1], rtol=0, atol=1e-8)
