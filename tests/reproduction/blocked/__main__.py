"""Runs feeds with and without blockages, and writes docs/results/blocked.md.

    python -m tests.reproduction.blocked --hours 10

Normal crushing is run in feeds of five simulated minutes, the scenes in turn, until there are so many hours of it.
What was run lies in build/reproduction/blocked, a file a feed, and is not run again: interrupt it, or bound it by
`--minutes`, and go on later. The page is written from what there is. Remove the folder after a change to what is
measured.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2

from lumpwatch.service.storage import replace_file
from tests.reproduction.blocked.page import Runs, page
from tests.reproduction.blocked.peers import best_limit
from tests.reproduction.blocked.run import run
from tests.reproduction.blocked.scenes import BLOCKED, NORMAL, TUNING, Scene

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "build" / "reproduction" / "blocked"
TUNING_S, BLOCKED_S, NORMAL_S = 120.0, 180.0, 300.0
KINDS = {"blocked": BLOCKED, "normal": NORMAL}


def main() -> None:
    """Run and write."""
    asked = _arguments()
    cv2.setNumThreads(1)
    KEPT.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + 60.0 * asked.minutes
    limits = _kept("limits", _tuned)
    for kind, scene, number in _pieces(asked.hours):
        if asked.kind in (None, kind) and time.monotonic() < until:
            _run(kind, scene, number, limits)
    runs: Runs = {(kind, scene.name): _runs(kind, scene) for kind in KINDS for scene in KINDS[kind]}
    (ROOT / "docs" / "results" / "blocked.md").write_text(page(runs, limits), encoding="utf-8")


def _arguments() -> argparse.Namespace:
    about = argparse.ArgumentParser(
        prog="python -m tests.reproduction.blocked",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    about.add_argument("kind", nargs="?", choices=KINDS, help="run these alone")
    about.add_argument(
        "--hours", type=float, default=10.0, help="of normal crushing there shall be in the end"
    )
    about.add_argument("--minutes", type=float, default=1e9, help="begin no other feed after so many")
    return about.parse_args()


def _pieces(hours: float) -> Iterator[tuple[str, Scene, int]]:
    for scene in BLOCKED:
        yield "blocked", scene, 0
    for k in range(round(3600.0 * hours / NORMAL_S)):
        yield "normal", NORMAL[k % len(NORMAL)], k // len(NORMAL)


def _run(kind: str, scene: Scene, number: int, limits: dict[str, float]) -> Any:
    seconds = BLOCKED_S if kind == "blocked" else NORMAL_S
    spec = scene.spec(number)
    return _kept(f"{_stem(kind, scene)}-{spec.seed}", lambda: run(spec, seconds, limits).plain())


def _runs(kind: str, scene: Scene) -> list[Any]:
    """Those that there are."""
    files = sorted(KEPT.glob(f"{_stem(kind, scene)}-*.json"))
    return [json.loads(file.read_text(encoding="utf-8")) for file in files]


def _stem(kind: str, scene: Scene) -> str:
    return f"{kind}-{scene.name}".replace(" ", "_")


def _tuned() -> dict[str, float]:
    moving = run(TUNING.spec(), TUNING_S).moving
    return {name: best_limit(values) for name, values in moving.items()}


def _kept(name: str, make: Callable[[], Any]) -> Any:
    file = KEPT / f"{name}.json"
    if not file.exists():
        began = time.process_time()
        made = make()
        replace_file(file, json.dumps(made).encode())
        sys.stdout.write(f"{name}: {time.process_time() - began:.0f} s\n")
        sys.stdout.flush()
    return json.loads(file.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
