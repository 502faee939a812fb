"""What waits to be written to an event log, as it was handed over."""

from __future__ import annotations

import threading

from lumpwatch.service.storage.event_log import Entry
from lumpwatch.service.storage.event_notes import Note


class Batch:
    """Some events, or news of what was published, and whether they are on the disk."""

    def __init__(
        self,
        entries: tuple[Entry, ...],
        sent: tuple[tuple[str, str], ...] = (),
        notes: tuple[Note, ...] = (),
    ) -> None:
        self.entries = entries
        self.sent = sent
        self.notes = notes
        self.rows = len(entries) + len(notes)
        self.done = threading.Event()
        self.written = False
        self.refused = 0
        """Rows whose values are such that they can never be written."""

    def parts(self) -> list[Batch]:
        """One for each row."""
        return [
            *(Batch((entry,)) for entry in self.entries),
            *(Batch((), notes=(note,)) for note in self.notes),
            *(Batch((), sent=(row,)) for row in self.sent),
        ]

    @property
    def name(self) -> str:
        """What it holds, for people."""
        ids = [f"{entry.event.roi}/{entry.event.id}" for entry in self.entries]
        ids += [f"{type(note).__name__} of {note.roi}" for note in self.notes]
        return ", ".join(ids) or "news of what was published"

    def finish(self, *, written: bool) -> None:
        """Tell who waits."""
        self.written = written
        self.done.set()
