# SPDX-License-Identifier: Apache-2.0

"""Threads that share a loop; NumPy and the compiled code release the interpreter lock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar('Item')
Result = TypeVar('Result')


def in_threads(
    function: Callable[[Item], Result], items: Iterable[Item], n_jobs: int
) -> list[Result]:
    """Return what a function gives for each item, computed by so many threads."""
    if n_jobs == 1:
        return list(map(function, items))
    with ThreadPoolExecutor(n_jobs) as threads:
        return list(threads.map(function, items))
