# SPDX-License-Identifier: Apache-2.0

"""The command line of a node: `--help` lists its parameters; unknown arguments are refused."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from .parameters import Spec


def check_arguments(program: str, about: str, specs: Sequence[Spec] = ()) -> None:
    """Check the arguments of this process besides those of ROS.

    Parameters
    ----------
    program : str
        The name of the executable.
    about : str
        What the node does.
    specs : sequence of Spec
        Its parameters.

    Raises
    ------
    SystemExit
        0 after `--help`; 2 if there are arguments that are not of ROS.

    """
    example = next((f'-p {spec.name}:=...' for spec in specs), '-r __ns:=/robot1')
    parser = argparse.ArgumentParser(
        program,
        usage=f'{program} [--help] [--ros-args {example} ...]',
        description=about,
        epilog=_listed(specs),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(remove_ros_args(sys.argv)[1:])


def _listed(specs: Sequence[Spec]) -> str:
    """Return the parameters with their defaults, as help shows them."""
    if not specs:
        return ''
    lines = ['parameters, each given as --ros-args -p NAME:=VALUE:']
    for spec in specs:
        choices = f' One of: {", ".join(spec.choices)}.' if spec.choices else ''
        default = '' if spec.default == '' else f' Default: {_shown(spec.default)}.'
        lines.append(f'  {spec.name}')
        lines += textwrap.wrap(
            f'{spec.description}{choices}{default}', 80, initial_indent=' ' * 8,
            subsequent_indent=' ' * 8,
        )  # fmt: skip
    return '\n'.join(lines)


def _shown(default) -> str:
    return str(default).lower() if isinstance(default, bool) else str(default)
