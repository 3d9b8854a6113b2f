# SPDX-License-Identifier: Apache-2.0

"""The robots of the camera study: what their pictures show, and of whom."""

import numpy as np
import pytest

from studies.tasks.cameras import ANOTHER, GIVEN, HIDDEN, KINDS
from studies.tasks.drawn_arm import NUM_EPISODES, NUM_STEPS, arm_with_camera
from studies.tasks.environments import ENVIRONMENTS
from studies.tasks.environments import NUM_STEPS as MOST_STEPS
from studies.tasks.rendered_robots import SCENES, rendered_robot


def columns(episodes, names):
    states = np.vstack([episode.states for episode in episodes])
    return dict(zip(names, states.T, strict=True))


def test_the_camera_shows_the_object_of_its_own_robot_only():
    found = {}
    for kind in KINDS:
        episodes, names = arm_with_camera(8, kind)
        assert [len(episode) for episode in episodes] == [NUM_STEPS] * NUM_EPISODES
        found[kind] = columns(episodes, names)
        rewards = np.concatenate([episode.rewards for episode in episodes])
        # The home is on the left: an object on the right is far away, so cosines from left to
        # right, which are negative for it, go with the reward.
        along = np.corrcoef(found[kind]['camera[0,1]'], rewards)[0, 1]
        assert along > 0.15 if kind != ANOTHER else abs(along) < 0.1
    assert 'object_x' not in found[HIDDEN].keys() | found[ANOTHER].keys()
    given = found[GIVEN]
    for place, channel in (('object_x', 'camera[0,1]'), ('object_y', 'camera[1,0]')):
        assert np.corrcoef(given[place], given[channel])[0, 1] < -0.4


def test_a_rendered_camera_shows_the_pole_of_its_own_robot_only(monkeypatch):
    pytest.importorskip('mujoco', reason='mujoco is not here')
    monkeypatch.setenv('MUJOCO_GL', 'egl')
    try:
        ENVIRONMENTS['inverted_pendulum'].make(render_mode='rgb_array').render()
    except Exception as error:  # Of what kind depends on the drivers.
        pytest.skip(f'nothing can be rendered here: {error}')
    monkeypatch.setitem(SCENES, 'inverted_pendulum',
                        SCENES['inverted_pendulum']._replace(num_episodes=12))  # fmt: skip
    found = {}
    for kind in KINDS:
        episodes, names = rendered_robot('inverted_pendulum', 3, kind)
        assert len(episodes) == 12
        assert max(map(len, episodes)) <= MOST_STEPS
        found[kind] = columns(episodes, names)
    assert found[HIDDEN].keys() == found[ANOTHER].keys()
    assert found[GIVEN].keys() - found[HIDDEN].keys() == {'angle', 'angular_velocity'}
    # The robot does the same in all three, and the picture is a function of cart and pole.
    given = found[GIVEN]
    np.testing.assert_array_equal(given['position'], found[ANOTHER]['position'])
    places = np.column_stack([np.ones_like(given['angle']), given['position'], given['angle']])

    def explained(view):
        left = view - places @ np.linalg.lstsq(places, view, rcond=None)[0]
        return 1 - left.var() / view.var()

    assert explained(found[HIDDEN]['camera[0,1]']) > 0.9
    assert explained(found[ANOTHER]['camera[0,1]']) < 0.5
