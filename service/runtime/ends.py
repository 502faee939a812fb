"""How a process ended, in words: a signal's number tells nobody that a disk is full."""

from __future__ import annotations

import signal

_MEANS = {
    signal.SIGBUS: "/dev/shm, or the disk of a file that it maps, is full",
    signal.SIGKILL: "no memory was left, or somebody killed it",
    signal.SIGSEGV: "a fault in compiled code",
    signal.SIGABRT: "compiled code gave up, as where no memory is left",
}


def how_ended(code: int | None) -> str:
    """`code` as `multiprocessing` has it: negative for a signal."""
    if code is None or code >= 0:
        return f"exit code {code}"
    try:
        number = signal.Signals(-code)
    except ValueError:  # a real-time signal
        return f"signal {-code}"
    return f"{number.name}: {_MEANS[number]}" if number in _MEANS else number.name
