# SPDX-License-Identifier: Apache-2.0

"""Episodes from before a change are told from those after it."""

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.changing_task import num_outdated
from cmifs_ros.core.selecting import select

NAMES = ('a', 'b', 'c')


def episodes_paid_for(channel, count, seed):
    """Return episodes whose reward is one of three channels, with as much noise."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(count, 10, 3))
    rewards = states[:, :, channel] + rng.normal(size=(count, 10))
    return [Episode(s, r) for s, r in zip(states, rewards, strict=True)]


def outdated(stream, channels, **options):
    episodes = ConditionalMISelector(gamma=0.9).thin(stream)
    return num_outdated(episodes, channels, least_kept=20, gamma=0.9, random_state=0, **options)


def test_the_moment_is_found():
    for seed in range(5):
        stream = episodes_paid_for(0, 50, seed) + episodes_paid_for(1, 50, 100 + seed)
        assert 40 <= outdated(stream, (0, 1)) <= 60


def test_a_battery_that_drains_does_not_hide_it():
    for seed in range(5):
        stream = episodes_paid_for(0, 50, seed) + episodes_paid_for(1, 50, 100 + seed)
        for i, episode in enumerate(stream):
            episode.states.flags.writeable = True
            episode.states[:, 2] = 100 - 0.5 * i - 0.01 * np.arange(10)
        assert 40 <= outdated(stream, (0, 1, 2)) <= 60


def test_where_nothing_changes_nothing_is_outdated():
    found = [outdated(episodes_paid_for(0, 80, seed), (0,)) for seed in range(40)]
    assert np.count_nonzero(found) <= 1


@pytest.mark.parametrize('num_episodes', [2, 29, 31])
def test_the_newest_are_never_outdated(num_episodes):
    stream = episodes_paid_for(0, num_episodes - 2, 0) + episodes_paid_for(1, 2, 1)
    assert outdated(stream, (0, 1)) <= max(0, num_episodes - 20)


def test_a_selection_rests_on_what_fits_and_says_what_does_not():
    stream = episodes_paid_for(0, 50, 0) + episodes_paid_for(1, 50, 1)
    kept = select(stream, NAMES, 'conditional_mi', {})
    assert (set(kept.names), kept.outdated, kept.episodes) == ({'a', 'b'}, 0, 100)
    selection = select(stream, NAMES, 'conditional_mi', {}, least_kept=20)
    assert selection.names == ('b',)
    assert selection.outdated + selection.episodes == 100
    assert select(stream, NAMES, 'kdr', {'target': 'a'}, least_kept=20).outdated == 0


def test_where_the_action_is_the_target_another_behaviour_is_a_change():
    def followed(channel, count, seed):
        rng = np.random.default_rng(seed)
        states = rng.normal(size=(count, 5, 3))
        return [Episode(s, None, s[:, channel] + 0.1 * rng.normal(size=5)) for s in states]

    stream = followed(0, 50, 1) + followed(1, 50, 2)
    assert 40 <= outdated(stream, (0, 1), target='action') <= 60
    assert outdated(followed(0, 80, 3), (0,), target='action') == 0
    # Nothing is paid: by the return nothing can change.
    assert outdated(stream, (0, 1)) == 0
