"""Some of the experiments, written below a folder of one's own: for developing."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from tests.reproduction.paper1 import DOCS, main, shortened  # noqa: E402 - threads are counted at import
from tests.reproduction.paper1.experiments import EXPERIMENTS  # noqa: E402

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.reproduction.paper1", description=__doc__)
    parser.add_argument("keys", nargs="*", choices=[[], *(e.key for e in EXPERIMENTS)], help="experiments")
    parser.add_argument("--quick", action="store_true", help="four seeds only")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for results/ and images/")
    arguments = parser.parse_args()
    chosen = [e for e in EXPERIMENTS if not arguments.keys or e.key in arguments.keys]
    main([shortened(e) for e in chosen] if arguments.quick else chosen, arguments.out)
