"""The table of faults: a row for each test, and the page that they make."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Row:
    """What one fault led to, as seen from outside."""

    fault: str
    done: str
    """What the test did."""
    noticed_by: str
    """What an outsider sees; where there is nothing to notice, what goes on."""
    noticed_s: float | None
    """Seconds from the fault until then; None: there is nothing to notice."""
    noticed_limit_s: float | None
    lost: int
    """Alarms of the event log that an outside subscriber did not get."""
    recovery: str
    recovered_s: float | None
    """Seconds from the end of the fault until decisions (or what `recovery` names) are back."""
    recovered_limit_s: float | None

    def check(self) -> None:
        """Assert the limits."""
        assert self.lost == 0
        for value, limit in (
            (self.noticed_s, self.noticed_limit_s),
            (self.recovered_s, self.recovered_limit_s),
        ):
            assert (value is None) == (limit is None)
            assert value is None or limit is None or 0.0 <= value <= limit, self


Record = Callable[[Row], None]


def write(row: Row, folder: Path) -> None:
    """Leave the row for `read`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{time.time_ns()}.json").write_text(json.dumps(asdict(row)), encoding="utf-8")


def read(folder: Path) -> list[Row]:
    """All rows, in the order in which they were written."""
    return [Row(**json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]


def page(rows: Iterable[Row], version: str, measured: str) -> str:
    """The page in Markdown; `measured` is a sentence on when and on what the rows were measured."""
    lines = [
        "<!-- Written by `python -m tests.faults` from what the tests measured; run that instead of editing. -->",
        "",
        "# Faults",
        "",
        f"Each fault was really done to a running lumpwatch {version}: real processes, a real bus, a real RTSP",
        "server; what is in the table was seen from outside, by a client of the bus and on the page of metrics.",
        "`blind_after_s` was 1 s. In brackets stands the limit that the test asserts; it leaves room for a busy",
        "machine. Lost is what stands in the event log and did not come to a subscriber of the bus, which must",
        "get every record once and in the order of its sequence. While the picture is dead or unfit, no region read",
        "CLEAR for longer than the limit in the third column. A `-` means that there is nothing to notice or to",
        "recover from. Attacks are those of a program of the same host that reaches the bus without TLS.",
        "",
        measured,
        "",
        "| fault | what was done | seconds until noticed (limit) | alarms lost | how it recovers, seconds (limit) |",
        "|---|---|---|---|---|",
    ]
    lines += [_line(row) for row in rows]
    return "\n".join(lines) + "\n"


def _line(row: Row) -> str:
    noticed = f"{_seconds(row.noticed_s, row.noticed_limit_s)}: {row.noticed_by}"
    recovered = f"{row.recovery}: {_seconds(row.recovered_s, row.recovered_limit_s)}"
    return f"| {row.fault} | {row.done} | {noticed} | {row.lost} | {recovered} |"


def _seconds(value: float | None, limit: float | None) -> str:
    return "-" if value is None else f"{value:.1f} ({limit:g})"
