# SPDX-License-Identifier: Apache-2.0

"""Valid names of channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .words import listed

#: Greatest number of channels, and of characters in a name.
MAX_CHANNELS = 4096
MAX_NAME_LENGTH = 256


def problem_of_names(names: Sequence[str]) -> str:
    """Return why these cannot be channel names; an empty string if they can."""
    if len(names) > MAX_CHANNELS:
        return f'{len(names)} channels; expected at most {MAX_CHANNELS}'
    if not all(0 < len(name) <= MAX_NAME_LENGTH for name in names):
        return f'a name that is empty or longer than {MAX_NAME_LENGTH} characters: {listed(names)}'
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        return f'repeated names: {listed(repeated)}'
    return ''
