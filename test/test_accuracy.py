"""The selections that the package is for, at the paper's size: 100 episodes of 20 steps."""

import pytest

from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.sim import rollout

SEEDS = range(10)


@pytest.fixture(scope='module', params=[(3, 'without_gravel'), (4, 'with_gravel')], ids=str)
def selections(request):
    count, scenario = request.param
    selected = [
        ConditionalMISelector(count)
        .fit(rollout(scenario, 100, seed))
        .get_support(indices=True)
        .tolist()
        for seed in SEEDS
    ]
    return scenario, selected


def test_relevant_sensors_come_first(selections):
    scenario, selected = selections
    if scenario == 'without_gravel':
        assert all({0, 1} <= set(s) for s in selected), selected
    else:
        assert sum(set(s) == {0, 1, 2, 3} for s in selected) >= 9, selected
