"""The operator's console: a web page on the bus, in a process of its own."""

from lumpwatch.service.console.server import ConsoleError, run_console
from lumpwatch.service.console.users import User, UserFile, UsersError

__all__ = ["ConsoleError", "User", "UserFile", "UsersError", "run_console"]
