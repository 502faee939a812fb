"""Which evidence has a verdict, by the event logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lumpwatch.service.evidence.store import Entry
from lumpwatch.service.storage import EventLogError, event_file, latest_verdicts, reading


def verdicts_by_id(path: Path) -> dict[tuple[str, str], str]:
    """The verdicts that count in an event log, by ROI and alarm id; none where it cannot be read."""
    try:
        with reading(path) as db:
            return {key: verdict.outcome.value for key, verdict in latest_verdicts(db).items()}
    except EventLogError:
        return {}


def judged(store: Path) -> Callable[[Entry], bool]:
    """Whether a piece of evidence has a verdict, by the event logs as they are now."""
    verdicts: dict[str, dict[tuple[str, str], str]] = {}

    def is_judged(entry: Entry) -> bool:
        if entry.camera not in verdicts:
            verdicts[entry.camera] = verdicts_by_id(event_file(store, entry.camera))
        return (entry.roi, entry.id) in verdicts[entry.camera]

    return is_judged
