"""Memory that is used again and again.

A fresh array of some megabytes costs more in page faults than in arithmetic.
"""

from __future__ import annotations

import numpy as np


class Workspace:
    """Named scratch arrays.

    An array is overwritten when its name is asked for again.
    """

    def __init__(self):
        self._buffers: dict[tuple[str, np.dtype], np.ndarray] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype) -> np.ndarray:
        """Return an array of arbitrary content, a view of the buffer of this name and type.

        The buffer grows as needed and keeps its content only while it is large enough.
        """
        size, key = int(np.prod(shape)), (name, np.dtype(dtype))
        if key not in self._buffers or self._buffers[key].size < size:
            self._buffers[key] = np.empty(size, dtype)
        return self._buffers[key][:size].reshape(shape)
