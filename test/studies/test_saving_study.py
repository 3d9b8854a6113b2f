# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')

from selections import selection, sensor

from studies.robot.saving import Run, measured
from studies.robot.saving_nodes import command_of
from studies.tasks.lidar_world import GOAL, NUM_RAYS


def test_the_controller_drives_to_the_goal_and_away_from_what_is_near():
    clear = {f'scan[{i}]': 4.0 for i in range(NUM_RAYS)}
    at_goal_height = {'x': 1.0, 'y': GOAL[1]}
    assert command_of(at_goal_height | clear) == pytest.approx([1.0, 0.0])
    assert command_of({'x': GOAL[0], 'y': 1.0} | clear) == pytest.approx([0.0, 1.0])
    # Ray 0 looks back, along -x.
    assert command_of(at_goal_height | clear | {'scan[0]': 0.2})[0] > 1.0
    # What is not selected is not needed.
    assert np.isfinite(command_of({})).all()
    assert np.isfinite(command_of({'x': float('nan'), 'scan[3]': float('nan')})).all()


def test_what_is_measured_tells_of_the_goals_measured_and_of_the_change():
    old, new = sensor('x', is_selected=True), sensor('motor', is_selected=True)
    run = Run([1.0, -1.0] * 20)
    run.switched_off = [(0, []), (10, ['/imu', '/other/scan']), (20, [])]
    run.selections = [
        (12, selection(old, number=1)),
        (33, selection(old, number=1, doubt='the data have changed')),
        (37, selection(old, new, number=2)),
    ]
    run.at = {
        n: {'seconds': 2.0 * n, 'sampler': 0.2 * n, 'lidar': n, 'messages': n, 'bytes': 500 * n}
        for n in range(1, 41)
    }
    assert list(measured(run, 10, 30).values()) == [
        '50%', '0.5 messages/s, 0.2 kB/s', '50% of a core', '10% of a core', '0.00 +- 0.22',
        'after 3 goals', 'after 7 goals',
    ]  # fmt: skip
    run.selections = run.selections[:1]
    assert list(measured(run, 10, 30).values())[-2:] == ['not', 'not']
