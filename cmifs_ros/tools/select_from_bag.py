"""Select from recorded bags: `ros2 run cmifs_ros select_from_bag BAG... --robot FILE`."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path

from cmifs_ros.collect.bag import BagError, episodes_of_bag
from cmifs_ros.collect.robot_file import RobotFileError, load_robot_file


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser('select_from_bag', description=__doc__)
    parser.add_argument('bags', nargs='+', metavar='BAG', help='a file or a folder')
    parser.add_argument('--robot', required=True, metavar='FILE', help='the robot file')
    parser.add_argument('--output', default='selection.json', metavar='FILE')
    options = parser.parse_args(arguments)
    try:
        return _run(options)
    except (BagError, RobotFileError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def _run(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from cmifs_ros.core.selection import select

    robot = load_robot_file(options.robot)
    episodes = []
    for bag in options.bags:
        with tqdm(desc=bag, unit=' messages', disable=None) as progress:
            found, sampler, assembler = episodes_of_bag(bag, robot, on_message=progress.update)
        episodes += found
        print(f'{bag}: {sum(sampler.received.values())} messages, {sampler.num_steps} steps, '
              f'{len(found)} episodes')  # fmt: skip
        for what, counts in (
            ('late messages', sampler.late),
            ('wrong messages', sampler.wrong),
            ('steps without', sampler.missing),
            ('dropped episodes', assembler.dropped_episodes),
        ):
            if counts:
                print(f'  {what}: {", ".join(f"{k} {n}" for k, n in counts.most_common())}')
    if len(episodes) < 2:
        raise BagError(f'{len(episodes)} whole episodes; expected at least 2')
    # A channel that never moves can tell nothing and is left to the selector as it is.
    settings = {'groups': robot.groups} if robot.groups else {}
    selection = select(episodes, robot.channel_names, 'conditional_mi', settings)
    for place, (name, score) in enumerate(
        zip(selection.ranking, selection.scores, strict=False), 1
    ):
        print(f'{place:3d}  {name:24s} {score:.4f}')
    print(f'selected: {", ".join(selection.names)}')
    Path(options.output).write_text(json.dumps(dataclasses.asdict(selection), indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
