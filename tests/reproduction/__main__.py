"""Runs the experiments and writes their pages and pictures into docs/: `make reproduce`.

Words on the command line choose some: lumps, difficulty, real, exact, paper1, background, jpda, imm, points,
manoeuvres, quality, pictures. What follows `difficulty` or `real` is for it:
`python -m tests.reproduction difficulty --help`.
"""

from __future__ import annotations

import os
import sys
import time

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# The libraries count their threads when they are imported.
from tests.reproduction import (  # noqa: E402
    difficulty,
    exact,
    imm,
    lumps,
    manoeuvres,
    paper1,
    paper3_background,
    paper3_jpda,
    pictures,
    points,
    quality,
)
from tests.reproduction.real import suite as real  # noqa: E402

EXPERIMENTS = {
    "lumps": lumps.main,
    "difficulty": difficulty.main,
    "real": real.main,
    "exact": exact.main,
    "paper1": paper1.main,
    "background": paper3_background.main,
    "jpda": paper3_jpda.main,
    "imm": imm.main,
    "points": points.main,
    "manoeuvres": manoeuvres.main,
    "quality": quality.main,
    "pictures": pictures.main,
}

if __name__ == "__main__":
    chosen, options = sys.argv[1:] or list(EXPERIMENTS), []
    if chosen[0] in ("difficulty", "real"):
        chosen, options = chosen[:1], chosen[1:]
    if unknown := set(chosen) - set(EXPERIMENTS):
        sys.exit(f"unknown experiment {', '.join(sorted(unknown))}; there are {', '.join(EXPERIMENTS)}")
    for experiment in chosen:
        began = time.monotonic()
        EXPERIMENTS[experiment](*([options] if options else []))
        print(f"{experiment}: {time.monotonic() - began:.0f} s")
