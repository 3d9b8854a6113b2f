r"""The file that brings the episodes and the last selection back after a restart.

Format, version 4::

    cmifs_ros episodes 4\n
    {"channels": [...], "lengths": [...], "selection": {...}, "selected_at": ...}\n
    the episodes, oldest first: states (T, v), then rewards (T,), float64, little-endian
    SHA-256 of all that stands before it (32 bytes)
    a record of each episode that was appended since

A record is T (8 bytes, little-endian), the CRC-32 of these (4 bytes), the episode, and the SHA-256
of the record before it (32 bytes). The last one is torn if its writer was killed meanwhile.

The second line is JSON. `lengths` gives the T of each episode before the records; `selection` is
null or what `fields_of` gives, with `means` and `spreads`; `selected_at` is in seconds of Unix
time. A selection in an older form, as in files of versions 2 and 3, is not read, but the episodes
are. Nothing in it can run code, and nothing is allocated before its size is known to be within the
bounds. Nothing here knows ROS.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

VERSION = 4
#: What can be read; of the older ones all but the selection.
READABLE = (2, 3, VERSION)
MAGIC = b'cmifs_ros episodes '
MAX_HEADER = 2**25
MAX_FILE = 2**35
CHUNK = 2**20
DIGEST_SIZE = hashlib.sha256().digest_size
RECORD_HEADER_SIZE = 12
VALUE = np.dtype('<f8')


@dataclass(frozen=True)
class Saved:
    """What survives a restart.

    Attributes
    ----------
    channel_names : tuple of str or None
        None if no channel is known yet.
    episodes : sequence of Episode
        Oldest first.
    selection : Selection or None
    selected_at : float
        When it was made, in seconds of Unix time; without a selection of no meaning.
    torn_bytes : int
        Of a file that was read: the part that was written of an episode when its writer was killed.

    """

    channel_names: tuple[str, ...] | None
    episodes: Sequence[Episode]
    selection: Selection | None = None
    selected_at: float = 0.0
    torn_bytes: int = 0


def record_header(length: int) -> bytes:
    """Return what a record of an episode of this length begins with."""
    number = length.to_bytes(8, 'little')
    return number + zlib.crc32(number).to_bytes(4, 'little')
