# SPDX-License-Identifier: Apache-2.0

"""A demonstration of the library without ROS: a simulated robot, a selection, a picture."""

from __future__ import annotations

import argparse
import os
import sys

from cmifs_ros.core.selecting import select
from cmifs_ros.sim import channel_names, rollout

from .demo_report import demo_parser, print_selection, save_picture
from .program import exit_code

NEXT = """\
next, your own robot, from a bag (docs/robot_file.md) or another recording
(docs/recordings.md):
  cmifs robot-file my_bag --out my_robot.yaml
  (define the reward in my_robot.yaml)
  cmifs select my_bag --robot my_robot.yaml --report page"""


def main(arguments: list[str] | None = None, program: str = 'demo') -> int:
    """Run the demo; return the exit code."""
    options = demo_parser(program, __doc__).parse_args(arguments)
    return exit_code(program, lambda: _run(options))


def _run(options: argparse.Namespace) -> None:
    names = channel_names(options.scenario)
    print(f'a simulated robot with {len(names)} sensors ({options.scenario}): selecting among them')
    print(f'from {options.episodes} episodes ...', flush=True)
    episodes = rollout(options.scenario, options.episodes, options.seed)
    settings = {'num_features': options.num_features, 'n_jobs': os.cpu_count()}
    selection = select(episodes, names, 'conditional_mi', settings)
    print_selection(selection, options.scenario)
    picture = save_picture(selection, options.scenario, options.out)
    print(f'\npicture: {picture}\n\n{NEXT}')


if __name__ == '__main__':
    sys.exit(main())
