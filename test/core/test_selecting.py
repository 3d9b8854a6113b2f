# SPDX-License-Identifier: Apache-2.0

"""The one result that everything shows."""

import numpy as np

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.selecting import select
from studies.tasks.synthetic import WORLDS, rollout_synthetic


def test_what_matters_is_selected_from_most_halves():
    episodes = rollout_synthetic('copy', 60, 0)
    names = WORLDS['copy'].channel_names
    found = select(episodes, names, 'conditional_mi', {}, num_halves=3)
    shares = {sensor.name: sensor.stability for sensor in found.sensors}
    assert set(shares.values()) <= {0, 1 / 3, 2 / 3, 1}
    assert shares['x'] + shares['copy'] >= 2 / 3
    assert max(shares[f'noise_{i}'] for i in range(1, 5)) <= 1 / 3
    assert found.confirmed == found.names
    without = select(episodes, names, 'conditional_mi', {})
    assert {sensor.stability for sensor in without.sensors} == {None}


def test_sensors_that_never_change_are_told_from_uninformative_ones():
    rng = np.random.default_rng(0)
    clock = np.arange(4.0)  # the same in all episodes, whichever change places
    states = np.column_stack([clock, np.ones(4)])
    episodes = [Episode(states, rng.normal(size=4)) for _ in range(6)]
    selection = select(episodes, ('clock', 'still'), 'conditional_mi', {})
    clock, still = selection.sensors
    assert (clock.name, clock.supporting_channels, clock.is_constant) == (
        'clock',
        ('clock',),
        False,
    )
    assert (still.name, still.supporting_channels, still.is_constant) == ('still', (), True)
    assert selection.changing == (clock,)


def test_the_result_of_a_sensor_is_what_the_selector_found_of_it():
    rng = np.random.default_rng(1)
    states = rng.normal(size=(30, 4, 4))
    episodes = [Episode(s, s[:, 2] + 0.1 * rng.normal(size=4)) for s in states]
    names, groups = ('a', 'b', 'c', 'd'), {'arm': ['a', 'c']}
    found = select(episodes, names, 'conditional_mi', {'groups': groups})
    own = ConditionalMISelector(groups=groups).fit(episodes, names)
    assert (found.names, found.indices) == (('a', 'c'), (0, 2))
    arm = found.sensors[0]
    assert (arm.name, arm.channels, arm.supporting_channels) == ('arm', ('a', 'c'), ('c',))
    assert (arm.is_selected, arm.status) == (True, 'confirmed')
    for place, sensor in enumerate(found.sensors):
        assert sensor.name == own.sensor_names_[own.ranking_[place]]
        assert sensor.score == own.scores_[place]
        assert (sensor.pvalue, sensor.status) == (own.pvalues_[place], own.statuses_[place])
        assert sensor.null_band == tuple(own.null_scores_[place])
    plain = select(episodes, names, 'kdr', {'target': 'c', 'num_features': 2})
    assert [s.is_selected for s in plain.sensors] == [True, True]
    assert {(s.status, s.pvalue, s.null_band) for s in plain.sensors} == {(None, None, None)}
