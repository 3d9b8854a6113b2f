"""The selections that the package is for, at the paper's size: 100 episodes of 20 steps."""

import joblib
import pytest

from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.sim import rollout

SEEDS = range(10)


def select(scenario, count, seed):
    selector = ConditionalMISelector(count).fit(rollout(scenario, 100, seed))
    return selector.get_support(indices=True).tolist()


@pytest.mark.parametrize(
    ('scenario', 'count', 'relevant', 'least'),
    [('without_gravel', 3, {0, 1}, 10), ('with_gravel', 4, {0, 1, 2, 3}, 9)],
)
def test_relevant_sensors_come_first(scenario, count, relevant, least):
    with joblib.parallel_config(backend='loky', inner_max_num_threads=1):
        selected = joblib.Parallel(n_jobs=2)(
            joblib.delayed(select)(scenario, count, seed) for seed in SEEDS
        )
    assert sum(relevant <= set(s) for s in selected) >= least, selected
