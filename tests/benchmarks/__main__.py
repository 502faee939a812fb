"""Runs all benchmarks and prints their figures."""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from tests.benchmarks import pipeline  # noqa: E402 - threads are counted at import

if __name__ == "__main__":
    print("Pipeline, 1920 x 1080 H.264, one ROI (CPU time a frame)")
    for figure, value in pipeline.run().items():
        print(f"  {figure:20} {value:8.2f}")
