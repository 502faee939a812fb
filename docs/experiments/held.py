"""`python -m docs.experiments.held STATES LABELS … EMPTY`: how long an object is held, and what is seen where none is.

For each pair of a replay and its labels the share of labelled frames, from the 16th on, with existence above 0.5; for
all files the frames without a label in which it is above 0.5, of which those right after the object has gone are given
apart: there the filter still expects it.
"""

from __future__ import annotations

import json
import sys
from itertools import zip_longest
from pathlib import Path

SETTLED, AFTER = 15, 10


def held(states: Path, labels: Path | None) -> tuple[float | None, int, int]:
    """Share of frames held, false frames just after the object, and all other false frames."""
    lines = [json.loads(line) for line in states.read_text(encoding="utf-8").splitlines()]
    above = {line["frame"] for line in lines if line["existence"] > 0.5}
    rows = [] if labels is None else labels.read_text(encoding="utf-8").split()
    there = sorted({int(row.split(",")[0]) for row in rows})
    false = above - set(there)
    after = {frame for frame in false if there and 0 < frame - there[-1] <= AFTER}
    share = sum(frame in above for frame in there[SETTLED:]) / len(there[SETTLED:]) if there else None
    return share, len(after), len(false - after)


def main(paths: list[str]) -> dict[str, float]:
    """The figures of all files."""
    pairs = zip_longest(map(Path, paths[::2]), map(Path, paths[1::2]))
    found = [held(states, labels) for states, labels in pairs]
    shares = [share for share, _, _ in found if share is not None]
    return {
        "held": sum(shares) / len(shares),
        "false_after": sum(after for _, after, _ in found),
        "false": sum(other for _, _, other in found),
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(sys.argv[1:]), indent=2) + "\n")
