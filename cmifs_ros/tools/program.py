# SPDX-License-Identifier: Apache-2.0

"""Entry points of the commands: errors and interruptions give one line, not a traceback."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from collections.abc import Callable


class CommandError(RuntimeError):
    """The command cannot continue; the message says why."""


def start(module: str, *arguments) -> int:
    """Run `main` of a module; return the exit code."""
    end_at_signals()
    try:
        try:
            return importlib.import_module(module).main(*arguments)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has ended, such as `head`. Python would flush to it once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE


def end_at_signals() -> None:
    """Let SIGINT and SIGTERM end the process at once, without a message.

    The imports of a command take a second or more, before it has begun any work.
    """
    _on_signals(lambda number, _: os._exit(128 + number))


def demo() -> int:
    """Run the demo of the nodes."""
    return start('cmifs_ros.tools.demo')


def downstream() -> int:
    """Run the downstream node."""
    end_at_signals()
    from cmifs_ros.ros.node_arguments import check_arguments

    check_arguments('downstream', 'Print the selected state; an example of a node that uses it.')
    return start('cmifs_ros.tools.downstream')


def make_robot_file(*arguments) -> int:
    """Write a first robot file, from a bag or the running robot."""
    return start('cmifs_ros.tools.make_robot_file', *arguments)


def select_from_bag(*arguments) -> int:
    """Select from recordings: bags, tables, HDF5, robot learning data sets."""
    _limit_threads()
    return start('cmifs_ros.tools.select_from_bag', *arguments)


def library_demo(*arguments) -> int:
    """Run a demonstration on a simulated robot, without ROS."""
    _limit_threads()
    return start('cmifs_ros.tools.library_demo', *arguments)


def watch(*arguments) -> int:
    """Show a running selector (needs ROS 2)."""
    return start('cmifs_ros.tools.watch', *arguments)


def _limit_threads() -> None:
    """Limit BLAS to one thread: for small matrices, threads only wait for each other."""
    for library in ('OPENBLAS', 'MKL', 'OMP', 'BLIS'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')


#: The commands of `cmifs`.
COMMANDS: dict[str, Callable[..., int]] = {
    'select': select_from_bag,
    'robot-file': make_robot_file,
    'watch': watch,
    'demo': library_demo,
}


def cmifs() -> int:
    """Run one of `COMMANDS`; return the exit code."""
    end_at_signals()
    commands = '\n'.join(f'  {name:12}{run.__doc__}' for name, run in COMMANDS.items())
    parser = argparse.ArgumentParser(
        'cmifs', usage='cmifs COMMAND ...', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Which sensors can a robot do without, and what would it cost?\n\n'
        f'commands:\n{commands}\n\n`cmifs COMMAND --help` lists the options of a command.',
    )  # fmt: skip
    parser.add_argument('command', nargs='?', choices=COMMANDS, help=argparse.SUPPRESS)
    parser.add_argument('arguments', nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.command is None:
        parser.print_help()
        return 0
    program = f'cmifs {options.command}'
    try:
        return COMMANDS[options.command](options.arguments, program)
    except ModuleNotFoundError as error:
        if error.name != 'rclpy':
            raise
        print(f'{program}: this needs ROS 2, but finds no rclpy: source ROS 2', file=sys.stderr)
        return 1


def exit_code(program: str, run: Callable[[], None], what_then: str = 'nothing is kept') -> int:
    """Run a command; return the exit code. `what_then` says what an interruption leaves behind."""
    # Its import takes long: at the top, signals would come before they are handled.
    from concurrent.futures.process import BrokenProcessPool

    signals = []

    def interrupt(number, _):
        signals.append(number)
        if len(signals) == 1:  # A second signal would interrupt the clean-up.
            raise KeyboardInterrupt

    _on_signals(interrupt)
    try:
        run()
    except CommandError as error:
        if isinstance(error.__cause__, BrokenPipeError):
            raise error.__cause__ from None
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except (BrokenProcessPool, KeyboardInterrupt):
        if not signals:
            print(f'{program}: a worker process died; {what_then}', file=sys.stderr)
            return 1
        print(f'\n{program}: interrupted; {what_then}', file=sys.stderr)
        return 128 + signals[0]
    return 0


def _on_signals(handler: Callable) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)
