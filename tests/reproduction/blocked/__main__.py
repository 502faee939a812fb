"""Runs what was not run yet, and writes docs/results/blocked.md: `python -m tests.reproduction.blocked`.

`blocked` or `normal` runs these alone, without the page, so that two processes share the work; `page` writes the page
from what was run so far, and says what was not. What was run lies in build/reproduction/blocked, a file for each feed;
remove it
after a change.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2

from lumpwatch.service.simulator import FeedSpec
from tests.reproduction.blocked.page import page
from tests.reproduction.blocked.peers import best_limit
from tests.reproduction.blocked.run import run
from tests.reproduction.blocked.scenes import BLOCKED, NORMAL, TUNING, Scene

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "build" / "reproduction" / "blocked"


def main() -> None:
    """Run and write."""
    cv2.setNumThreads(1)
    KEPT.mkdir(parents=True, exist_ok=True)
    limits = _kept("limits", _tuned)
    kinds = {"blocked": BLOCKED, "normal": NORMAL}
    asked = sys.argv[1] if sys.argv[1:] else ""
    runs = {
        (kind, scene.name): [_run(kind, scene, spec, limits) for spec in scene.specs()]
        for kind in kinds
        for scene in kinds[kind]
        if asked in ("", kind)
        or (asked == "page" and all(_file(kind, scene, spec).exists() for spec in scene.specs()))
    }
    if asked in kinds:
        return
    (ROOT / "docs" / "results" / "blocked.md").write_text(page(runs, limits), encoding="utf-8")


def _run(kind: str, scene: Scene, spec: FeedSpec, limits: dict[str, float]) -> Any:
    return _kept(_file(kind, scene, spec).stem, lambda: run(spec, 60 * scene.minutes, limits).plain())


def _file(kind: str, scene: Scene, spec: FeedSpec) -> Path:
    return KEPT / f"{kind}-{scene.name}-{spec.seed}.json".replace(" ", "_")


def _tuned() -> dict[str, float]:
    moving: dict[str, list[tuple[float, bool]]] = {}
    for spec in TUNING.specs():
        for name, values in run(spec, 60 * TUNING.minutes).moving.items():
            moving.setdefault(name, []).extend(values)
    return {name: best_limit(values) for name, values in moving.items()}


def _kept(name: str, make: Any) -> Any:
    file = KEPT / f"{name}.json"
    if not file.exists():
        made = make()
        file.write_text(json.dumps(made), encoding="utf-8")
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()
    return json.loads(file.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
