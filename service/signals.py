"""What a process does when it is told to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable


def on_end_signals(end: Callable[[], None], insisted: Callable[[], None] = lambda: None) -> None:
    """SIGTERM and SIGINT call `end` once, in a thread; further ones `insisted`, in the main thread.

    To be called in the main thread.
    """
    told = False

    def handle(*_: object) -> None:
        nonlocal told
        if told:
            insisted()
            return
        told = True
        # By another thread: the one that is interrupted may hold a lock that `end` needs.
        threading.Thread(target=end, name="end", daemon=True).start()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)
