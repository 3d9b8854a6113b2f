# SPDX-License-Identifier: Apache-2.0

"""The world of the camera study: what its pictures show, and of whom."""

import numpy as np

from studies.accuracy.camera import ANOTHER, GIVEN, HIDDEN, NUM_EPISODES, NUM_STEPS, recording


def test_the_camera_shows_the_object_of_its_own_robot_only():
    found = {}
    for kind in (HIDDEN, GIVEN, ANOTHER):
        episodes, names = recording(8, kind)
        assert [len(episode) for episode in episodes] == [NUM_STEPS] * NUM_EPISODES
        states = np.vstack([episode.states for episode in episodes])
        found[kind] = dict(zip(names, states.T, strict=True))
        rewards = np.concatenate([episode.rewards for episode in episodes])
        # The home is on the left: an object on the right is far away, so cosines from left to
        # right, which are negative for it, go with the reward.
        along = np.corrcoef(found[kind]['camera[0,1]'], rewards)[0, 1]
        assert along > 0.15 if kind != ANOTHER else abs(along) < 0.1
    assert 'object_x' not in found[HIDDEN].keys() | found[ANOTHER].keys()
    given = found[GIVEN]
    for place, channel in (('object_x', 'camera[0,1]'), ('object_y', 'camera[1,0]')):
        assert np.corrcoef(given[place], given[channel])[0, 1] < -0.4
