"""Arguments of `lumpwatch evaluate`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "evaluate",
        late("evaluate", "evaluate"),
        "Compare a tracking result with labelled truth: detection and tracking accuracy (VACE), CLEAR MOT "
        "and identity metrics.",
        "lumpwatch evaluate out/states.jsonl gt.txt --roi apron",
    )
    parser.add_argument(
        "result",
        type=Path,
        metavar="RESULT",
        help="states.jsonl of a replay, or MOTChallenge text: frame,id,x,y,w,h,…",
    )
    parser.add_argument("truth", type=Path, metavar="TRUTH", help="labels, MOTChallenge text")
    parser.add_argument(
        "--threshold",
        type=float,
        default=0.5,
        help="least overlap (intersection over union) of a pair of boxes, 0 to 1 (default 0.5)",
    )
    parser.add_argument("--camera", metavar="ID", help="camera, where a states.jsonl holds several")
    parser.add_argument("--roi", metavar="ID", help="ROI, where a states.jsonl holds several")
    parser.add_argument(
        "--counted", action="store_true", help="only objects that count for the alarm, of a states.jsonl"
    )
    parser.add_argument("--json", action="store_true", help="print all scores and counts as JSON")
