"""Runs all benchmarks, prints their figures and writes docs/results/speed.md."""

from __future__ import annotations

import os
import sys

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from tests.benchmarks import background, cost, events, peers, pipeline, report, scaling  # noqa: E402 - threads are set first


def main() -> None:
    """All benchmarks, the quick ones first."""
    print("Full step against OpenCV's MOG2")
    mog2 = background.run()
    print(report.table(report.background_rows(mog2)))

    peer = None
    if (stone_soup := peers.stone_soup_version()) is None:
        print("\nStone Soup is not installed, comparison left out: uv pip install --group bench")
    else:
        print(f"\nFull step against Stone Soup {stone_soup}")
        peer = peers.run()
        print(report.table(report.peer_rows(peer)))

    print("\nCost against particles and ROIs")
    costs = scaling.run()
    for rows in report.scaling_rows(*costs):
        print(report.table(rows))

    print("\nPipeline, 1920 x 1080 H.264, one ROI (CPU time a frame)")
    whole = pipeline.run()
    for figure, value in whole.items():
        print(f"  {figure:20} {value:8.2f}")
    report.write(peer, mog2, costs, whole)
    print(f"\nwritten: {report.PAGE}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["events"]:
        events.main(sys.argv[2:])
    elif sys.argv[1:] == ["cost"]:
        cost.main()
    else:
        main()
