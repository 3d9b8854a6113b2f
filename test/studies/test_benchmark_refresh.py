import re

import pytest

from cmifs_ros.sim import rollout
from studies.methods import default_criterion
from studies.speed import refresh as benchmark_refresh
from studies.speed.refresh import RefreshedMI


def test_on_the_same_episodes_a_refresh_scores_as_the_full_search_did():
    episodes = rollout('with_gravel', 12, seed=0)
    subsets = [(i,) for i in range(5)]
    full = RefreshedMI(episodes, {})
    scores = full(subsets)
    assert full(subsets) == pytest.approx(scores, abs=1e-4)
    exact = default_criterion(episodes, seed=0)(subsets)
    assert scores == pytest.approx(exact, abs=1e-3)
    # Of another width the scores would be others.
    elsewhere = {subset: (points + 18) % 81 for subset, points in full.points.items()}
    assert RefreshedMI(episodes, elsewhere)(subsets) != pytest.approx(scores, abs=1e-2)


def test_the_command_prints_what_a_refresh_saves(capsys):
    assert benchmark_refresh.main(['--episodes', '8', '--top', '2', '--trials', '2']) == 0
    out = capsys.readouterr().out
    assert 'with_gravel, 8 episodes of which one is exchanged, the best 2 ranked, 2 trials' in out
    assert 0 < float(re.search(r'refresh / full \| ([0-9.]+)', out)[1]) < 5
