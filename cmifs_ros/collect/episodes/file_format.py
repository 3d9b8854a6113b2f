# SPDX-License-Identifier: Apache-2.0

r"""The file that brings the episodes and the last selection back after a restart.

Format, version 5::

    cmifs_ros episodes 5\n
    {"channels": [...], "actions": [...], "sources": [...], "episodes": [[T, a, source], ...],
     "selection": {...}, "selected_at": ...}\n                               (this is one line)
    the episodes, oldest first: states (T, v), rewards (T,), then actions (T, a), as float64
    SHA-256 of all that stands before it (32 bytes)
    a record of each episode that was appended since

A record is T (8 bytes), a (4 bytes), the size of the source's name (4 bytes), the CRC-32 of these
(4 bytes), that name as UTF-8, the episode, and the SHA-256 of the record before it (32 bytes). The
last one is torn if its writer was killed meanwhile. All numbers are little-endian.

The second line is JSON. `actions` has the names of the values of an action, of which an episode has
all or none; `episodes` gives the T and a of each before the records, and where in `sources` its
source is; `selection` is null or what `fields_of` gives, with `means` and `spreads`; `selected_at`
is in seconds of Unix time. Versions 2 to 4 have `lengths` in place of `episodes`, no actions and no
sources, and their records begin with T and the CRC-32. A selection in an older form is not read.
Nothing in it can run code, and nothing is allocated before its size is known to be within the
bounds. Nothing here knows ROS.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

VERSION = 5
#: What can be read; of the older ones all but the selection.
READABLE = (2, 3, 4, VERSION)
MAGIC = b'cmifs_ros episodes '
MAX_HEADER = 2**25
MAX_FILE = 2**35
CHUNK = 2**20
DIGEST_SIZE = hashlib.sha256().digest_size
VALUE = np.dtype('<f8')


@dataclass(frozen=True)
class Saved:
    """What survives a restart.

    Attributes
    ----------
    channel_names : tuple of str or None
        None if no channel is known yet.
    action_names : tuple of str
        Of the values of the actions, of which an episode has all or none.
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
    action_names: tuple[str, ...] = ()


class RecordHeader(NamedTuple):
    """What a record begins with.

    Attributes
    ----------
    length : int
        Steps.
    num_actions : int
        Values of an action.
    source_size : int
        Bytes of the name of the source.

    """

    length: int
    num_actions: int = 0
    source_size: int = 0

    def packed(self, version: int = VERSION) -> bytes:
        """Return its bytes, in a file of this version."""
        numbers = struct.pack(_LAYOUTS[version], *self[: 1 if version < VERSION else 3])
        return numbers + zlib.crc32(numbers).to_bytes(_CRC_SIZE, 'little')

    @classmethod
    def unpacked(cls, content: bytes, version: int) -> RecordHeader:
        """Return what was packed; it is to be compared with `packed`, since it may be damaged."""
        return cls(*struct.unpack(_LAYOUTS[version], content[:-_CRC_SIZE]))


def record_header_size(version: int) -> int:
    """Return the bytes of a record's header in a file of this version."""
    return struct.calcsize(_LAYOUTS[version]) + _CRC_SIZE


_CRC_SIZE = 4
_LAYOUTS = dict.fromkeys(READABLE[:-1], '<Q') | {VERSION: '<QII'}
