# SPDX-License-Identifier: Apache-2.0

"""Write a first robot file, from the running robot or a bag."""

from __future__ import annotations

import argparse
import shutil
import sys

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import robot_file_of_recording
from cmifs_ros.collect.robot_file.template import USE_SIM_TIME, robot_file_of_topics

from .arguments import home_path, new_file, number_from
from .bags import bag_opener, with_progress
from .program import CommandError, exit_code


def main(arguments: list[str] | None = None, program: str = 'make_robot_file') -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(program, description=__doc__)
    parser.add_argument(
        'recording',
        nargs='?',
        type=home_path,
        metavar='BAG',
        help='a bag, or tables of messages (default: listen to the running robot)',
    )
    parser.add_argument('--bag', type=home_path, metavar='BAG', help='the same as BAG')
    parser.add_argument(
        '--seconds', type=number_from(1), default=5, metavar='N',
        help='seconds to listen (default 5)',
    )  # fmt: skip
    parser.add_argument(
        '--out',
        type=new_file,
        metavar='FILE',
        help='file to create (default: print to the terminal)',
    )
    options = parser.parse_args(arguments)
    if options.recording and options.bag:
        parser.error('BAG is given twice')
    options.bag = options.bag or options.recording
    return exit_code(program, lambda: _run(options), 'nothing is written')


def _run(options: argparse.Namespace) -> None:
    try:
        text = (
            robot_file_of_recording(options.bag, with_progress, bag_opener())
            if options.bag
            else _listen(options.seconds)
        )
        if options.out is None:
            print(text, end='')
            return
        options.out.parent.mkdir(parents=True, exist_ok=True)
        with options.out.open('x') as file:
            file.write(text)
    except (RecordingError, OSError) as error:
        raise CommandError(str(error)) from error
    has_ros2 = shutil.which('ros2')  # The nodes run without it, too.
    run = 'ros2 run cmifs_ros ' if has_ros2 else 'install/cmifs_ros/lib/cmifs_ros/'
    if options.bag:
        # Where pip installed the package, it has no other command.
        select = 'cmifs select' if shutil.which('cmifs') else f'{run}select_from_bag'
        then = f'{select} {options.bag} --robot {options.out}'
    elif has_ros2:
        then = f'ros2 launch cmifs_ros robot.launch.xml robot_file:={options.out}'
        then += ' use_sim_time:=true' if USE_SIM_TIME in text else ''
    else:
        time = ' -p use_sim_time:=true' if USE_SIM_TIME in text else ''
        then = (
            f'{run}sampler_node --ros-args -p robot_file:={options.out}{time}, and '
            f'{run}selector_node' + (f' --ros-args{time}' if time else '')
        )
    print(f'written: {options.out}; complete what is marked TODO, then run: {then}')


def _listen(seconds: int) -> str:
    from cmifs_ros.ros.graph_survey import survey

    print(f'listening for {seconds} s ...', file=sys.stderr, flush=True)
    heard, unknown, is_simulated = survey(seconds)
    if not any(one.count for one in heard):
        raise CommandError(
            f'no message was heard in {seconds} s; is the robot running, with the same '
            'ROS_DOMAIN_ID? --seconds listens longer; BAG reads a recording'
        )
    text = robot_file_of_topics('the running robot', heard, is_simulated)
    return text + ''.join(f'# {line}\n' for line in unknown)


if __name__ == '__main__':
    sys.exit(main())
