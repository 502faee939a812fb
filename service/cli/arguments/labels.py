"""Arguments of `lumpwatch labels`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "labels",
        late("labels", "labels"),
        "Make labelled clips of judged alarms: true ones with the boxes of their tracks for `train`, false "
        "ones as clips without a lump.",
        "lumpwatch labels site.yaml --from-verdicts --out labelled",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--from-verdicts",
        action="store_true",
        required=True,
        help="of the alarms with a verdict and evidence",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder for clips and labels")
    add_json(parser, "print how many clips were made and left out as JSON")
