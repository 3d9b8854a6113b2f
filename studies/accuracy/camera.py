# SPDX-License-Identifier: Apache-2.0

"""How often a camera is confirmed beside joint states, and when it should not be.

An arm whose pictures are drawn, and robots of MuJoCo whose pictures are rendered. In some
recordings only the camera shows what matters, in others the joint states show it too, or the
camera is that of another robot.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial

import numpy as np

from cmifs_ros.collect.sensor_groups import groups_by_name
from cmifs_ros.core.selecting import select
from cmifs_ros.core.statuses import STATUSES
from cmifs_ros.tools.program import CommandError, exit_code
from studies.tasks import drawn_arm
from studies.tasks.cameras import ANOTHER, GIVEN, HIDDEN, KINDS
from studies.tasks.drawn_arm import arm_with_camera
from studies.tasks.registry import what_is_missing
from studies.tasks.rendered_robots import SCENES, rendered_robot
from studies.trials.arguments import add_log, add_names, study_parser
from studies.trials.log import TrialLog, kept
from studies.trials.parallel import finish
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table
from studies.trials.trial import Outcome, Trial

#: From a seed and one of `KINDS` to episodes and the names of their channels.
ROBOTS = {'arm': arm_with_camera} | {name: partial(rendered_robot, name) for name in SCENES}
NUM_EPISODES = {'arm': drawn_arm.NUM_EPISODES} | {
    name: scene.num_episodes for name, scene in SCENES.items()
}
_WORDS = {
    HIDDEN: 'only the camera shows it',
    GIVEN: 'the joint states show it too',
    ANOTHER: 'it is that of another robot',
}


def camera_of(trial: Trial) -> Outcome:
    """Return the status of the camera in a recording, as its place in `STATUSES`."""
    episodes, names = ROBOTS[trial.scenario](trial.seed, trial.method)
    settings = {'groups': groups_by_name(names), 'random_state': trial.seed}
    actions = [f'action_{i}' for i in range(episodes[0].actions.shape[1])]
    found = select(episodes, names, 'conditional_mi', settings, action_names=actions)
    (camera,) = (sensor for sensor in found.sensors if sensor.name == 'camera')
    return Outcome(trial, (STATUSES.index(camera.status),), found.seconds)


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the table."""
    log = TrialLog(options.log)
    for robot in options.robots:
        if robot in SCENES and (missing := what_is_missing(SCENES[robot].environment)):
            raise CommandError(f'{robot}: {missing}')
    last = options.first_seed + options.trials - 1
    wanted = [
        Trial(robot, kind, NUM_EPISODES[robot], number, options.first_seed + number)
        for number in range(options.trials)
        for robot in options.robots
        for kind in KINDS
    ]
    results = finish(wanted, log, options.jobs, run=camera_of)
    rows = []
    for robot in options.robots:
        for kind in KINDS:
            found = results.of(robot, kind, NUM_EPISODES[robot])
            shares = [
                '{:.0%} ± {:.0%}'.format(*mean_and_error([o.ranking == (i,) for o in found]))
                for i in range(len(STATUSES))
            ]
            seconds = f'{np.median([o.seconds for o in found]):.1f}'
            rows.append((robot, NUM_EPISODES[robot], _WORDS[kind], *shares, seconds))
    print(f'\n{options.trials} recordings each, seeds {options.first_seed} to {last}.\n')
    print(markdown_table(('robot', 'episodes', 'the camera', *STATUSES, 'seconds'), rows), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('camera', __doc__, trials=20, first_seed=1000)
    add_names(parser, '--robots', ROBOTS, ROBOTS)
    add_log(parser)
    options = parser.parse_args(arguments)
    return exit_code('camera', lambda: run(options), kept(options.log))


if __name__ == '__main__':
    sys.exit(main())
