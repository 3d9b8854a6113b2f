"""The one result that everything shows."""

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import select
from studies.synthetic import WORLDS, rollout_synthetic


def test_what_matters_is_selected_from_most_halves():
    episodes = rollout_synthetic('copy', 60, 0)
    names = WORLDS['copy'].channel_names
    found = select(episodes, names, 'conditional_mi', {}, num_halves=3)
    shares = dict(zip(found.ranking, found.stability, strict=True))
    assert set(shares.values()) <= {0, 1 / 3, 2 / 3, 1}
    assert shares['x'] + shares['copy'] >= 2 / 3
    assert max(shares[f'noise_{i}'] for i in range(1, 5)) <= 1 / 3
    assert found.confirmed == found.names
    assert select(episodes, names, 'conditional_mi', {}).stability == ()


def test_sensors_that_never_change_are_told_from_those_that_tell_nothing():
    rng = np.random.default_rng(0)
    clock = np.arange(4.0)  # the same in all episodes, whichever change places
    states = np.column_stack([clock, np.ones(4)])
    episodes = [Episode(states, rng.normal(size=4)) for _ in range(6)]
    selection = select(episodes, ('clock', 'still'), 'conditional_mi', {})
    assert selection.ranking == ('clock', 'still')
    assert selection.supporting_channels == (('clock',), ())
    assert selection.num_live == 1
