"""Library, queue and notes of one console, put together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.work.jobs import Job, Queue
from lumpwatch.service.console.work.library import Library
from lumpwatch.service.console.work.orders import SuggestOrder, command, read_order
from lumpwatch.service.console.work.tracks import from_proposals
from lumpwatch.service.console.work.trials import Deeds


@dataclass(frozen=True, slots=True)
class Workshop:
    """Where engineers work."""

    library: Library
    queue: Queue
    deeds: Deeds

    def close(self) -> None:
        """End what runs."""
        self.queue.close()
        self.library.close()


def open_workshop(config: SiteConfig, path: Path) -> Workshop:
    """The workshop in the store of a site; `path` is the configuration file."""
    root = config.store.path / "console"
    half = config.console.work_mb << 19
    library = Library(root / "clips", half)

    def arguments(job: Job, folder: Path) -> list[str]:
        return command(read_order(job.order), path, library, folder)

    def done(job: Job, folder: Path) -> None:
        order = read_order(job.order)
        if isinstance(order, SuggestOrder):
            library.propose(
                order.clip, from_proposals((folder / "proposals.txt").read_text(encoding="utf-8"))
            )

    return Workshop(library, Queue(root / "jobs", half, arguments, done), Deeds(root / "deeds.jsonl"))
