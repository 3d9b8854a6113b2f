# SPDX-License-Identifier: Apache-2.0

"""Restrict BLAS to one thread, because the matrices here are small.

On busy cores, several BLAS threads mostly wait for each other, and a selection takes up to ten
times as long. The commands and the node's worker set OPENBLAS_NUM_THREADS before they import NumPy.
In a program that has already imported NumPy, only threadpoolctl can limit the threads (optional:
pip install threadpoolctl; scikit-learn depends on it).
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

try:
    from threadpoolctl import threadpool_limits
except ImportError:
    threadpool_limits = None


def one_blas_thread() -> AbstractContextManager:
    """Return a context in which BLAS uses one thread; it does nothing without threadpoolctl."""
    return nullcontext() if threadpool_limits is None else threadpool_limits(1, 'blas')
