# SPDX-License-Identifier: Apache-2.0

"""Child processes of a command, which end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from .program import CommandError


class InterruptionError(RuntimeError):
    """The command was interrupted by a signal, the argument."""


class Processes:
    """The child processes of a command; leaving the context ends them all.

    While it exists, SIGINT and SIGTERM take effect at the next `check`. Raised anywhere else, they
    could leave behind a process that is just being started.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._running: dict[str, subprocess.Popen] = {}
        self._signals: list[int] = []
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _: self._signals.append(number))

    def start(self, name: str, *command: str) -> None:
        """Start a process with its output in a file."""
        with self.log(name).open('w') as output:
            self._running[name] = subprocess.Popen(
                command, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
            )

    def log(self, name: str) -> Path:
        """Return the file with the output of a process."""
        return self._folder / f'{name}.log'

    def lines(self, name: str) -> list[str]:
        """Return the complete lines that a process has written so far."""
        return self.log(name).read_text().split('\n')[:-1]

    def check(self) -> None:
        """Raise if a signal has arrived or a process has ended."""
        if self._signals:
            raise InterruptionError(self._signals[0])
        for name, process in self._running.items():
            if process.poll() is not None:
                raise CommandError(
                    f'the {name} ended early with exit code {process.returncode}:\n'
                    + self.log(name).read_text()
                )

    def __enter__(self) -> Processes:
        """Return itself."""
        return self

    def __exit__(self, *_) -> None:
        """End all processes: interrupt first, then kill."""
        for process in self._running.values():
            process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + 2
        for process in self._running.values():
            try:
                process.wait(max(0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def executable(name: str) -> str:
    """Return the path that `ros2 run cmifs_ros NAME` starts."""
    try:
        path = Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros', name)
    except (PackageNotFoundError, LookupError, OSError) as error:
        raise CommandError(
            'the package cmifs_ros is not installed here; build it with colcon and source '
            'install/setup.bash, or use `make demo`'
        ) from error
    return str(path)


def stay_apart() -> None:
    """Keep nodes of this process and its children on this machine and apart from other nodes.

    Existing environment variables take precedence.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
