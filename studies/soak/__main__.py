# SPDX-License-Identifier: Apache-2.0

"""Inject faults and load into a running selector; print what was lost, as a Markdown table."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from cmifs_ros.tools.processes import stay_apart
from cmifs_ros.tools.program import exit_code

from .control import Control
from .faults import Faults
from .loads import Loads


class Soak(Loads, Faults, Control):
    """All that is done to a selector, and to a sampler beside it."""


PARTS = tuple(
    name
    for kind in (Loads, Faults, Control)
    for name, value in vars(kind).items()
    if callable(value) and name[0] != '_'
)


def run(options: argparse.Namespace) -> None:
    """Do the parts asked for and print the table."""
    print('| injected | how often | lost or measured |\n|---|---|---|', flush=True)
    with tempfile.TemporaryDirectory(prefix='cmifs_soak_') as folder:
        soak = Soak(Path(folder), options.scale)
        for part in options.parts or PARTS:
            for row in getattr(soak, part)():
                print(f'| {" | ".join(row)} |', flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the soak; return the exit code."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument('parts', nargs='*', metavar='PART', help=f'of {", ".join(PARTS)}; or all')
    parser.add_argument('--scale', type=float, default=1.0, help='1: the full run; less is shorter')
    options = parser.parse_args(arguments)
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f'{", ".join(sorted(unknown))}; expected some of {", ".join(PARTS)}')
    stay_apart()
    return exit_code('soak', lambda: run(options), 'its nodes are ended')


if __name__ == '__main__':
    sys.exit(main())
