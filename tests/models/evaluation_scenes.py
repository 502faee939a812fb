"""Scenes for the evaluation metrics, of boxes 10 wide and 10 high.

Shifted by s along one axis two of them overlap by (10 - s) / (10 + s): by 2/3 for s = 2, by 3/7 for s = 4,
by 1/3 for s = 5.
"""

from __future__ import annotations

from lumpwatch.models.evaluation import Tracks, tracks_of


def scene(*rows: tuple[int, int, float] | tuple[int, int, float, float]) -> Tracks:
    """Boxes of 10 x 10 from (frame, id, left) or (frame, id, left, top)."""
    boxes = [(row[2], row[3] if len(row) > 3 else 0.0, 10.0, 10.0) for row in rows]
    return tracks_of([row[0] for row in rows], [row[1] for row in rows], boxes)


def track(of: int, frames: range, left: float = 0.0) -> tuple[tuple[int, int, float], ...]:
    return tuple((t, of, left) for t in frames)
