"""What processes have in memory."""

from __future__ import annotations

from pathlib import Path


def pss_kib(pid: int) -> int:
    """The proportional set size of a process: what processes share counts once, divided among them."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
