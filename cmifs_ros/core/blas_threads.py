"""One thread for the linear algebra, since the matrices here are small.

On busy cores several threads mostly wait for each other, so that a selection takes up to ten times
as long. The commands and the nodes' worker set OPENBLAS_NUM_THREADS before NumPy is imported; in a
program that has imported it, only threadpoolctl can do so (optional: pip install threadpoolctl; it
comes along with scikit-learn).
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

try:
    from threadpoolctl import threadpool_limits
except ImportError:
    threadpool_limits = None


def one_blas_thread() -> AbstractContextManager:
    """Return a context in which the linear algebra of this process has one thread."""
    return nullcontext() if threadpool_limits is None else threadpool_limits(1, 'blas')
