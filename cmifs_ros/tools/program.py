# SPDX-License-Identifier: Apache-2.0

"""How the commands begin and end: errors and interruption are one sentence each, or silence."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool


class CommandError(RuntimeError):
    """The command cannot go on; the message says why."""


def start(module: str) -> int:
    """Run `main` of a module; return the exit code."""
    end_at_signals()
    return importlib.import_module(module).main()


def end_at_signals() -> None:
    """From now on have SIGINT and SIGTERM end the process at once, in silence.

    The imports of a command take a second or more, and what it does has not begun.
    """
    _on_signals(lambda number, _: os._exit(128 + number))


def demo() -> int:
    """Run the demo."""
    return start('cmifs_ros.tools.demo')


def downstream() -> int:
    """Run the downstream node."""
    return start('cmifs_ros.tools.downstream')


def make_robot_file() -> int:
    """Write a first robot file."""
    return start('cmifs_ros.tools.make_robot_file')


def select_from_bag() -> int:
    """Select from recorded bags."""
    # Its products of matrices are small: on busy cores, threads would only wait for each other.
    for library in ('OPENBLAS', 'MKL', 'OMP', 'BLIS'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')
    return start('cmifs_ros.tools.select_from_bag')


def watch() -> int:
    """Run the live view."""
    return start('cmifs_ros.tools.watch')


def exit_code(program: str, run: Callable[[], None], what_then: str = 'nothing is kept') -> int:
    """Run a command and return the exit code; `what_then` says what an interruption leaves."""
    signals = []

    def interrupt(number, _):
        signals.append(number)
        if len(signals) == 1:  # A second one would interrupt the cleaning up.
            raise KeyboardInterrupt

    _on_signals(interrupt)
    try:
        run()
    except CommandError as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except (BrokenProcessPool, KeyboardInterrupt):
        if not signals:
            print(f'{program}: a worker process died; {what_then}', file=sys.stderr)
            return 1
        print(f'\n{program}: interrupted; {what_then}')
        return 128 + signals[0]
    return 0


def _on_signals(handler: Callable) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)
