# SPDX-License-Identifier: Apache-2.0

"""A field of a topic's messages that could be a channel, with the values observed."""

from __future__ import annotations

import math
import re

from cmifs_ros.collect.encoders import Encoder
from cmifs_ros.core.words import first

from .field_path import FieldPath, MissingFieldError
from .model import Source

#: A text, or an integer with up to this many values, may be a category.
FEWEST_CATEGORIES, MOST_CATEGORIES = 3, 8
#: A text that `one_hot` accepts.
_WORD = re.compile(r'[A-Za-z_][\w -]{0,39}')


class ObservedField:
    """A field of a topic's messages, and the values observed so far.

    Attributes
    ----------
    path : FieldPath
    text : str
        The path as a robot file writes it.
    options : str
        Options that it needs in the file.
    num_seen : int
        Number of messages that had it.

    """

    def __init__(
        self, path: FieldPath, text: str, encoder: Encoder | None = None, inf: str | None = None
    ):
        self.path, self.text = path, text
        self.options = f', as: {encoder.name}' if encoder else f', inf: {inf}' if inf else ''
        self.num_seen = 0
        self._source = Source('', path, encoder, inf=inf)
        self._newest: list[float] = []
        self._problem = ''
        self._first = [math.nan] * len(self._source.names)
        self._is_changed = False
        self._categories: set[int] | None = set()
        self._words: dict[str, None] = {}

    @property
    def is_open(self) -> bool:
        """Whether another message could add information."""
        return not self._is_changed or self._categories is not None or self._is_unknown

    @property
    def _is_unknown(self) -> bool:
        return any(map(math.isnan, self._first))

    def look(self, message) -> None:
        """Observe the values of a message."""
        try:
            self._newest = self._source.readings(message)
        except MissingFieldError as error:  # such as a shorter array or a missing joint
            self._problem = str(error)
            self._look_at_text(message)
            return
        if not self._newest:
            return
        self.num_seen += 1
        for i, value in enumerate(self._newest):
            if math.isfinite(value):
                if self._is_unknown and math.isnan(self._first[i]):
                    self._first[i] = value
                self._is_changed |= value != self._first[i]
        if self._categories is not None:
            raw = self._raw(message)
            is_whole = isinstance(raw, (int, bytes)) and not isinstance(raw, bool)
            found = self._categories | {int(self._newest[0])} if is_whole else None
            self._categories = found if found and len(found) <= MOST_CATEGORIES else None

    def _raw(self, message) -> object:
        found = self.path.values_in(message)
        return found[0] if len(found) == 1 else None

    def _look_at_text(self, message) -> None:
        try:
            value = self._raw(message)
        except MissingFieldError:
            return
        if isinstance(value, str):
            self.num_seen += 1
            if len(self._words) <= MOST_CATEGORIES:
                self._words[value[:41]] = None

    @property
    def is_text(self) -> bool:
        """Whether a value was not a number."""
        return bool(self._words)

    @property
    def words(self) -> list[str]:
        """The texts observed, if they may be categories; otherwise empty."""
        words = list(self._words)
        is_few = 2 <= len(words) <= MOST_CATEGORIES
        return words if is_few and all(map(_WORD.fullmatch, words)) else []

    @property
    def shown_words(self) -> str:
        """The texts observed, for display."""
        return first([repr(word) for word in self._words])

    @property
    def why_not(self) -> str:
        """Why it is not proposed as a channel; empty if it is."""
        if self._source.encoder and not self.num_seen:
            return self._problem
        never = [
            (name, new)
            for name, value, new in zip(self._source.names, self._first, self._newest, strict=False)
            if math.isnan(value)
        ]
        if never:
            return f'always {", ".join(sorted({_shown(new) for _, new in never}))} here' + (
                f': {first([name for name, _ in never])}' if len(self._first) > 1 else ''
            )
        if not self._is_changed:
            return f'never changed: {first(list(dict.fromkeys(map(_shown, self._first))))}'
        return ''

    @property
    def categories(self) -> str:
        """The values of an integer, if they are few; otherwise empty."""
        if self._categories is None or len(self._categories) < FEWEST_CATEGORIES:
            return ''
        return ', '.join(map(str, sorted(self._categories)))


def _shown(value: float) -> str:
    return 'NaN' if math.isnan(value) else f'{value:.6g}'
