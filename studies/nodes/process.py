# SPDX-License-Identifier: Apache-2.0

"""Nodes in separate processes, and the resources they use."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

from cmifs_ros.tools.processes import executable
from cmifs_ros.tools.program import CommandError


class Process:
    """A node in a separate process; leaving the context ends it."""

    def __init__(self, folder: Path, *command: str, namespace: str = '/', **parameters):
        settings = [w for k, v in parameters.items() for w in ('-p', f'{k}:={json.dumps(v)}')]
        settings += ['-r', f'__ns:={namespace}']
        self.log = folder / f'{len(list(folder.iterdir()))}.log'
        with self.log.open('w') as output:
            self._process = subprocess.Popen(
                [*command, '--ros-args', *settings], stdout=output, stderr=subprocess.STDOUT
            )
        self.pid = self._process.pid

    @classmethod
    def selector(cls, folder: Path, **parameters) -> Process:
        """Start the selector like a user."""
        return cls(folder, executable('selector_node'), **parameters)

    def has_ended(self) -> bool:
        """Return whether it has ended."""
        return self._process.poll() is not None

    def cpu_seconds(self) -> float:
        """Return the processor time used so far, without the worker."""
        fields = Path(f'/proc/{self.pid}/stat').read_text().rsplit(')', 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def resident_bytes(self) -> int:
        """Return the memory in use."""
        pages = int(Path(f'/proc/{self.pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE')

    def kill(self) -> None:
        """Kill it with SIGKILL."""
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Process:
        """Return itself."""
        return self

    def __exit__(self, kind, *_) -> None:
        """End it; raise if its output has a traceback."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(2)
            except subprocess.TimeoutExpired:
                self.kill()
                if kind is None:
                    raise CommandError(f'not ended within 2 s:\n{self.log.read_text()}') from None
        if kind is None and 'Traceback' in self.log.read_text():
            raise CommandError(self.log.read_text())
