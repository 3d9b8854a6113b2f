"""Write a first robot file: `ros2 run cmifs_ros make_robot_file --bag BAG --out my_robot.yaml`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cmifs_ros.collect.bag import BagError
from cmifs_ros.collect.robot_template import robot_file_of_bag

from .program import StudyError, exit_code


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser('make_robot_file', description=__doc__)
    parser.add_argument('--bag', required=True, metavar='BAG', help='a file or a folder')
    parser.add_argument('--out', type=Path, metavar='FILE', help='a new file (default: print it)')
    options = parser.parse_args(arguments)
    return exit_code('make_robot_file', lambda: _run(options), 'nothing is written')


def _run(options: argparse.Namespace) -> None:
    try:
        text = robot_file_of_bag(options.bag)
        if options.out is None:
            print(text, end='')
            return
        with options.out.open('x') as file:
            file.write(text)
    except FileExistsError:
        raise StudyError(f'{options.out} exists; expected the name of a new file') from None
    except (BagError, OSError) as error:
        raise StudyError(str(error)) from error
    print(f'written: {options.out}; decide what is marked TODO in it, then: select_from_bag')


if __name__ == '__main__':
    sys.exit(main())
