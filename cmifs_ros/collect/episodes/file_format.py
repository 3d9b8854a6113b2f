# SPDX-License-Identifier: Apache-2.0

r"""The format of the file that restores the episodes and the last selection after a restart.

Format, version 6::

    cmifs_ros episodes 6\n
    {"channels": [...], "actions": [...], "sources": [...], "episodes": [[T, a, source], ...],
     "renewals": ..., "selection": {...}, "selected_at": ...}\n              (this is one line)
    the episodes, oldest first: states (T, v), rewards (T,), then actions (T, a), as float64
    SHA-256 of everything before it (32 bytes)
    a record of each episode appended since

A record is T (8 bytes), a (4 bytes), the size of the source's name (4 bytes), the renewals with
this episode (float64), the CRC-32 of these (4 bytes), that name as UTF-8, the episode, and the
SHA-256 of the record before it (32 bytes). The last one is incomplete if its writer was killed. All
numbers are little-endian.

The second line is JSON. `actions` names the values of an action, of which an episode has all or
none; `episodes` gives the T and a of each episode before the records, and the index of its source
in `sources`; `renewals` is that of the buffer, on which the level of the next selection depends;
`selection` is null or the result of `fields_of` with `means` and `spreads`; `selected_at` is Unix
time in seconds. Version 5 has no renewals. Versions 2 to 4 have `lengths` instead of `episodes`, no
actions and no sources either, and their records begin with T and the CRC-32. A selection in an
older form is not read. Reading the file cannot run code, and sizes are checked before memory is
allocated.
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

VERSION = 6
#: Versions that can be read; of those before actions all but the selection.
READABLE = (2, 3, 4, 5, VERSION)
WITH_ACTIONS = 5
MAGIC = b'cmifs_ros episodes '
MAX_HEADER = 2**25
MAX_FILE = 2**35
CHUNK = 2**20
DIGEST_SIZE = hashlib.sha256().digest_size
VALUE = np.dtype('<f8')


@dataclass(frozen=True)
class Saved:
    """The contents of the file: what survives a restart.

    Attributes
    ----------
    channel_names : tuple of str or None
        None if the channels are not known yet.
    action_names : tuple of str
        Names of the values of an action; an episode has all or none.
    episodes : sequence of Episode
        Oldest first.
    selection : Selection or None
    selected_at : float
        When it was made, Unix time in seconds; meaningless without a selection.
    renewals : float
        As of `EpisodeBuffer`, of which the episodes may be the newest; 0 if unknown.
    torn_bytes : int
        Size of an incomplete last record in a file that was read.

    """

    channel_names: tuple[str, ...] | None
    episodes: Sequence[Episode]
    selection: Selection | None = None
    selected_at: float = 0.0
    torn_bytes: int = 0
    action_names: tuple[str, ...] = ()
    renewals: float = 0.0


class RecordHeader(NamedTuple):
    """The header of a record.

    Attributes
    ----------
    length : int
        Number of steps.
    num_actions : int
        Number of values of an action.
    source_size : int
        Bytes of the name of the source.
    renewals : float
        As of `EpisodeBuffer`, with this episode.

    """

    length: int
    num_actions: int = 0
    source_size: int = 0
    renewals: float = 0.0

    def packed(self, version: int = VERSION) -> bytes:
        """Return its bytes in a file of this version."""
        layout = _LAYOUTS[version]
        numbers = struct.pack(layout, *self[: len(layout) - 1])
        return numbers + zlib.crc32(numbers).to_bytes(_CRC_SIZE, 'little')

    @classmethod
    def unpacked(cls, content: bytes, version: int) -> RecordHeader:
        """Return the header from its bytes; compare it with `packed`, since they may be damaged."""
        return cls(*struct.unpack(_LAYOUTS[version], content[:-_CRC_SIZE]))


def record_header_size(version: int) -> int:
    """Return the bytes of a record's header in a file of this version."""
    return struct.calcsize(_LAYOUTS[version]) + _CRC_SIZE


_CRC_SIZE = 4
_LAYOUTS = {2: '<Q', 3: '<Q', 4: '<Q', 5: '<QII', VERSION: '<QIId'}
