"""Arguments of `lumpwatch report`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "report",
        late("report", "report"),
        "Report on a shift: lumps, sizes, warning and acknowledge times, blind minutes, precision and "
        "availability, from the event log and the verdicts.",
        "lumpwatch report site.yaml --shift last --out shift.html",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--shift",
        default="last",
        metavar="WHEN",
        help="last (default), current, a name, NAME@2026-11-22, or a time: 2026-11-22T06:00/12h",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="the page to write (default: none)")
    parser.add_argument(
        "--json",
        nargs="?",
        const="-",
        metavar="FILE",
        help="the same figures as JSON (default: standard output)",
    )
