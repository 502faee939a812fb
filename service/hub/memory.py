"""How much memory this process has and may have: Linux, and for what concerns the allocator the GNU C library.

Elsewhere nothing is known and nothing is bounded.
"""

from __future__ import annotations

import contextlib
import ctypes
import re
import resource
from pathlib import Path

STATUS = Path("/proc/self/status")
_ARENA_MAX, _ARENAS = -8, 2


def few_arenas() -> None:
    """Let all threads allocate from few arenas: what one thread has freed serves the others. Call it first."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, _ARENAS)


def give_back() -> None:
    """Give free memory back to the system."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def forbid_growth(by: int, status: Path = STATUS) -> None:
    """From now on this process cannot have more than `by` bytes on top of what it has: asking for more ends it.

    No core is written then: it would hold what was on the bus.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if has := _data(status):
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = has + by if hard == resource.RLIM_INFINITY else min(has + by, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _data(status: Path) -> int:
    """Bytes of data that this process has asked for; 0 where that is not known."""
    try:
        found = re.search(r"^VmData:\s*(\d+) kB$", status.read_text(), re.MULTILINE)
    except OSError:
        found = None
    return int(found[1]) << 10 if found else 0
