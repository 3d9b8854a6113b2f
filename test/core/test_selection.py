"""The one result that everything shows."""

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
