# SPDX-License-Identifier: Apache-2.0

"""What runs on this machine."""

from pathlib import Path


def group(leader):
    """Return the living processes of a process group."""
    found = []
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = stat.read_text().rsplit(')', 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if fields[0] != 'Z' and int(fields[2]) == leader:
            found.append(int(stat.parent.name))
    return found


def is_running(pid):
    """Tell whether a process lives; a zombie does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False
