"""Starting and watching the processes of the daemon."""

from lumpwatch.service.runtime.config_file import ConfigFile
from lumpwatch.service.runtime.daemon import Addresses, run
from lumpwatch.service.runtime.preflight import (
    check_priors,
    check_shared_memory,
    check_simulations,
)

__all__ = [
    "Addresses",
    "ConfigFile",
    "check_priors",
    "check_shared_memory",
    "check_simulations",
    "run",
]
