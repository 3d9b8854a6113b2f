# SPDX-License-Identifier: Apache-2.0

"""The selections that the package is for, at the paper's size: 100 episodes of 20 steps."""

import joblib
import pytest

from cmifs_ros.core.selecting import select
from cmifs_ros.sim import channel_names, rollout


@pytest.mark.parametrize(
    ('scenario', 'count', 'relevant', 'least'),
    [('without_gravel', 3, {'x', 'y'}, 5), ('with_gravel', 4, {'x', 'y', 'battery', 'gravel'}, 4)],
)
def test_relevant_sensors_come_first(scenario, count, relevant, least):
    names, settings = channel_names(scenario), {'num_features': count}
    with joblib.parallel_config(backend='loky', inner_max_num_threads=1):
        selections = joblib.Parallel(n_jobs=2)(
            joblib.delayed(select)(rollout(scenario, 100, seed), names, 'conditional_mi', settings)
            for seed in range(5)
        )
    selected = [selection.names for selection in selections]
    assert sum(relevant <= set(names) for names in selected) >= least, selected
