"""Starting and watching the processes of the daemon."""

from lumpwatch.service.runtime.daemon import Addresses, run
from lumpwatch.service.runtime.preflight import (
    check_priors,
    check_shared_memory,
    check_simulations,
)

__all__ = [
    "Addresses",
    "check_priors",
    "check_shared_memory",
    "check_simulations",
    "run",
]
