"""Arguments of `lumpwatch evidence`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "evidence",
        late("evidence", "evidence"),
        "List, show or fetch the evidence of alarms: clip without loss, still, curve and filter state.",
        "lumpwatch evidence fetch site.yaml 001763791200000-000012 --out alarms",
    )
    parser.add_argument("what", choices=("list", "show", "fetch"), help="what to do")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "id",
        nargs="?",
        metavar="ID",
        help="CAMERA/ROI/ID, or the id alone where it is the only one (show and fetch)",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to put a copy (fetch)")
    parser.add_argument(
        "--bus", action="store_true", help="ask the running daemon, not the store on this disk"
    )
    parser.add_argument("--json", action="store_true", help="print the records as they are (list)")
