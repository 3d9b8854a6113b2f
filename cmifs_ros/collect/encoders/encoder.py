# SPDX-License-Identifier: Apache-2.0

"""What each encoder offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable


class Encoder(ABC):
    """Encode a message, or a part of one, as a fixed number of channels.

    The result depends on the message alone, so it is the same live and from a recording, and
    nothing is fitted or kept. Equal encoders have equal options. For encoders of other packages see
    `installed`.

    Attributes
    ----------
    needed : tuple of tuple of str
        Sets of fields, of which a message needs one.
    expected : str
        The messages that it encodes, for errors.
    is_large : bool
        Whether few of these messages fit into memory, so that only a few may wait.

    """

    needed: tuple[tuple[str, ...], ...]
    expected: str
    is_large: bool = True

    @property
    def name(self) -> str:
        """What a robot file calls it, in `as`."""
        return type(self).__name__.lower()

    @property
    @abstractmethod
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its channels' names, such as `.sin` or `[0]`."""

    def fits(self, has: Callable[[str], bool]) -> bool:
        """Return whether a message has the fields that it needs, given which it has."""
        return any(all(map(has, names)) for names in self.needed)

    @abstractmethod
    def encode(self, message) -> list[float]:
        """Return the values, as many as `suffixes`; NaN where the message has none.

        Raises
        ------
        ValueError
            If the message contradicts itself, or has an unknown format.

        """
