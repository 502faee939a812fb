"""`lumpwatch report`: the figures of a shift from the event log, as a page."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from pathlib import Path
from zoneinfo import ZoneInfo

from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import EvidenceError, EvidenceStore, read_evidence
from lumpwatch.service.protocol import STILL
from lumpwatch.service.shift import Figures, read_shift, report_window, shift_figures
from lumpwatch.service.storage import EventLogError, event_file

MOST_STILLS = 100
"""So that the page of a bad day can still be opened."""


def report(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    now_s = time.time()
    about = report_window(arguments.shift, config.shifts, now_s)
    files = [event_file(config.store.path, camera.id) for camera in config.cameras]
    if not any(file.is_file() for file in files):
        raise EventLogError(f"{files[0].parent}: holds no event log (nothing has happened yet?)")
    records = read_shift(config, about)
    found = shift_figures(config.site, about, records, now_s)
    if arguments.out is not None:
        from lumpwatch.service.offline import shift_page

        zone = ZoneInfo(config.shifts.time_zone)
        _write(arguments.out, shift_page(found, records, about, zone, _stills(config, found)))
    if arguments.json is not None or arguments.out is None:
        text = json.dumps(found, indent=2) + "\n"
        if arguments.json in (None, "-"):
            sys.stdout.write(text)
        else:
            _write(Path(arguments.json), text)
    return 0


def _stills(config: SiteConfig, found: Figures) -> dict[tuple[str, str, str], bytes]:
    """The newest stills of the shift's alarms; what is damaged or gone is left out."""
    store = EvidenceStore(config.store.path)
    stills: dict[tuple[str, str, str], bytes] = {}
    for alarm in reversed(found["alarms"]):
        if alarm["evidence"] is None or len(stills) == MOST_STILLS:
            continue
        with contextlib.suppress(EvidenceError):
            evidence = read_evidence(store.folder(alarm["camera"], alarm["roi"], alarm["evidence"]))
            stills[alarm["camera"], alarm["roi"], alarm["id"]] = evidence.read(STILL)
    return stills


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise LumpwatchError(f"{path}: cannot be written ({error.strerror})") from error
