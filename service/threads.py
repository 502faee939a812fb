"""How many processors there are, and one thread a process for numerics.

Pictures are small and many: threads of BLAS wait for each other longer than they work, and processes fight for the
cores. The libraries read the environment when they are loaded, and processes that are started inherit it.
"""

from __future__ import annotations

import os

_LIBRARIES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def use_one_thread() -> None:
    """Tell libraries that are not loaded yet, and processes that are started from now on; a user's own wish holds."""
    for name in _LIBRARIES:
        os.environ.setdefault(name, "1")


def processor_count() -> int:
    """Those that this process may run on, as far as the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
