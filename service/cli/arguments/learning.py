"""Options that several commands have."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_judging(parser: argparse.ArgumentParser) -> None:
    """Add the options of judging and reporting."""
    parser.add_argument(
        "--report", type=Path, metavar="HTML", help="write the report here as well as beside the prior"
    )
    parser.add_argument(
        "--folds",
        type=int,
        default=5,
        metavar="N",
        help="parts of the cross-validation by lump in the report; 0 for none (default 5)",
    )
