"""Whole minutes of belts to fit the score of a box to: what a camera sees, one site after the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.jdt.row_profile import learn_profile
from lumpwatch.models.learning import LabelledView
from lumpwatch.models.learning.fit import Scene
from lumpwatch.models.roi import Roi
from lumpwatch.models.state import H, States, W, X, Y, blank
from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import load_config
from lumpwatch.service.core import working_luma
from lumpwatch.service.detection import make_region
from lumpwatch.service.storage import read_labels
from lumpwatch.service.training.model_builder.head import births_of

ROLES = "train", "watch"
_UNTRAINED = 3
"""In one of so many pictures, sizes are those of a region that nothing is known of; in the others those of its
lumps: a score must serve both."""


def site_scenes(feeds: Path, every: int) -> Iterator[Scene]:
    """Scenes of one picture each: one in `every` of the minutes of all sites in a folder, in order of their names."""
    for site in sorted(path for path in feeds.iterdir() if path.is_dir()):
        minutes = [_minute(site / role, every) for role in ROLES]
        views = [view for minute, _ in minutes for view in minute]
        lumps = np.concatenate([view.objects for view in views])
        if len(lumps) == 0:
            continue
        mask = minutes[0][1].mask
        sizes = learn_profile(lumps, float(mask.shape[0]))
        known, unknown = polygon_births(mask, sizes, np.ones(1)), births_of(mask, None)
        for number, view in enumerate(views):
            births: PolygonBirths = known if number % _UNTRAINED else unknown
            yield [view], births


def _minute(folder: Path, every: int) -> tuple[list[LabelledView], Roi]:
    """Pictures with their lumps, and with what is neither lump nor ore; and the region."""
    camera = load_config(folder / "site.yaml").cameras[0]
    frames, _ = read_frames(camera, folder / "video.mp4")
    lumps, unclear = _boxes(folder / "gt.txt"), _boxes(folder / "unclear.txt")
    views, region = [], None
    for number, frame in enumerate(frames, start=1):
        if region is None:
            region = make_region(camera.rois[0], frame.width, frame.height)
        if number % every == 0:
            view = region.view(working_luma(frame, region).copy())
            views.append(
                LabelledView(view, _states(region, lumps.get(number)), _states(region, unclear.get(number)))
            )
    if region is None:
        raise ValueError(f"{folder}: no picture")
    return views, region


def _boxes(file: Path) -> dict[int, list[tuple[float, ...]]]:
    """Boxes by frame; a file may be empty."""
    found: dict[int, list[tuple[float, ...]]] = {}
    if file.read_text(encoding="utf-8").strip():
        for box in read_labels(file):
            found.setdefault(box.frame, []).append((box.x, box.y, box.w, box.h))
    return found


def _states(region: Roi, boxes: list[tuple[float, ...]] | None) -> States:
    states = blank(len(boxes or ()))
    if boxes:
        working: NDArray[np.float64] = region.to_working(np.array(boxes))
        states[:, [X, Y, W, H]] = working
    return states
