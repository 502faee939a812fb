"""The score of a box that ships: a logistic regression over what the net says of composites and feeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.jdt.row_profile import around_limit, untrained_profile
from lumpwatch.models.learning import LabelledView, LumpFit, fit_lump
from lumpwatch.models.learning.fit import Scene
from lumpwatch.models.likelihood.lump import Maps
from lumpwatch.models.roi import Image, View
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.service.config import JdtConfig

LUMP, DOUBTFUL = 0.97, 0.72
"""Longer side of a lump's box, and of that of a body that is neither lump nor ore, in units of the limit."""
PATTERNS = 64
LEAST_LIMIT_PX = 22.0
"""In the middle row; smaller lumps are below what a region is set up for."""
LEAST_LUMP_PX = 14.0
_SPEED_H_S = 0.5
CROWDED, LARGE = 0.35, 1.6
"""Share of the belt that stones cover where they lie side by side; how much longer lumps are there than the stone in
the middle of that area."""


def labelled(files: Sequence[Path], every: int = 1) -> list[tuple[LabelledView, NDArray[np.float64], Image]]:
    """Pictures with their lumps, the limit by row, and the polygon."""
    found = []
    for file in files:
        with np.load(file) as archive:
            arrays = {key: archive[key] for key in ("grey", "inside", "limit", "boxes", "counts")}
        ends = np.cumsum(arrays["counts"])
        for k in range(0, len(ends), every):
            grey, limit = arrays["grey"][k], arrays["limit"][k].astype(np.float64)
            mask = np.repeat(np.repeat(arrays["inside"][k], 4, axis=0), 4, axis=1)
            if mask.sum() < 8000 or float(limit[len(limit) // 2]) < LEAST_LIMIT_PX:
                continue
            boxes = arrays["boxes"][ends[k] - arrays["counts"][k] : ends[k]].astype(np.float64)
            sides = boxes[:, 2:] - boxes[:, :2]
            middle = (boxes[:, :2] + boxes[:, 2:]) / 2
            row = np.clip(middle[:, 1], 0, len(limit) - 1).astype(int)
            relative = sides.max(axis=1) / limit[row]
            factor = _stretched(relative, np.prod(sides, axis=1), float(mask.sum()))
            relative, limit = relative / factor, limit * factor
            states = blank(len(boxes))
            states[:, [X, Y]], states[:, [W, H]] = middle, sides
            large = (relative >= LUMP) & (sides.min(axis=1) >= LEAST_LUMP_PX)
            lumps, doubtful = states[large], states[(relative >= DOUBTFUL) & ~large]
            view = View(grey, None, np.asarray(cv2.integral(mask), np.int32))
            found.append((LabelledView(view, lumps, doubtful), limit, mask))
    return found


def _stretched(relative: NDArray[np.float64], areas: NDArray[np.float64], whole: float) -> float:
    """By how much a picture's limit is raised, so that where stones of all sizes lie side by side only large ones
    are lumps: `relative` are their sizes in units of the limit (n,), `areas` those of their boxes.
    """
    if len(areas) == 0 or areas.sum() < CROWDED * whole:
        return 1.0
    order = np.argsort(relative)
    reached = np.cumsum(areas[order]) >= 0.5 * areas.sum()
    return max(1.0, LARGE * float(relative[order][reached][0]))


def births_of(mask: Image, limit: NDArray[np.float64] | None) -> PolygonBirths:
    """Boxes as a filter without a prior tries them, with a limit or without."""
    profile = untrained_profile(mask, JdtConfig().size_h, _SPEED_H_S)
    return polygon_births(mask, around_limit(profile, limit), np.ones(1))


def fit_head(
    files: Sequence[Path], sites: Iterable[Scene], maps: Maps, every: int = 1, patterns: int = PATTERNS
) -> LumpFit:
    """The score fitted to pictures, half of them as of a region with a limit, and to whole minutes of sites."""
    scenes: list[Scene] = list(sites)
    for number, (item, limit, mask) in enumerate(labelled(files, every)):
        scenes.append(([item], births_of(mask, limit if number % 2 else None)))
    return fit_lump(scenes, np.random.default_rng(1), maps, patterns=patterns)
