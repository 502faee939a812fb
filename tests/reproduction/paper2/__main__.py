"""The experiment alone, written below a folder of one's own: for developing."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from tests.reproduction.paper2 import DOCS, RUNS, main  # noqa: E402 - threads are counted at import

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.reproduction.paper2", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two runs a row only")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for results/ and images/")
    arguments = parser.parse_args()
    main(arguments.out, 2 if arguments.quick else RUNS)
