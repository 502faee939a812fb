"""What a training has not seen, in words, each with what to do about it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.state import X, Y
from lumpwatch.service.training.cross_validation import Validation
from lumpwatch.service.training.dataset import Material

LEAST_COVERED = 0.5
"""Share of the region's length, along the way that lumps take, over which labels should lie."""
LEAST_SIZE_RATIO = 1.25
"""Ratio of the largest to the smallest lump, each against what its rows expect."""
SHORT_S = 1.0


def coverage_warnings(material: Material, learned: Learned) -> tuple[str, ...]:
    """What the labels do not cover."""
    states = np.concatenate([view.objects for view in material.footage.views])
    return (
        *_outside(material),
        *_one_end(material, states),
        *_sizes(material, learned),
        *_short(material),
    )


def validation_warnings(validation: Validation, material: Material) -> tuple[str, ...]:
    """What held-out lumps say."""
    warnings = [f"cross-validation: {failure}: label more lumps" for failure in validation.failures]
    if missed := validation.missed:
        names = ", ".join(f"{held.lump.id} of {material.clips[held.lump.clip].name}" for held in missed[:4])
        names += ", …" if len(missed) > 4 else ""
        warnings.append(
            f"{len(missed)} of {len(validation.whole)} lumps would not be found by what the others teach "
            f"({names}): look at them in the report; if their boxes are right, label more lumps like them"
        )
    return tuple(warnings)


def _outside(material: Material) -> list[str]:
    warnings = []
    if material.outside:
        clip, track = material.outside[0]
        more = f" and {len(material.outside) - 1} more" if len(material.outside) > 1 else ""
        warnings.append(
            f"lump {track} of {material.clips[clip].name}{more}: labelled outside the ROI all the time and not "
            "used: check the polygon, or whether the labels belong to this video"
        )
    roi = material.footage.roi
    corners = roi.corners.astype(np.float32)
    boxes = [box for clip in material.clips for box in clip.boxes]
    out = sum(
        cv2.pointPolygonTest(corners, (box.x + box.w / 2, box.y + box.h / 2), measureDist=False) < 0
        for box in boxes
    )
    if out > len(boxes) / 4:
        warnings.append(
            f"{out} of {len(boxes)} boxes have their centre outside the polygon: draw the polygon around all "
            "places where a lump can be"
        )
    return warnings


def _one_end(material: Material, states: NDArray[np.float64]) -> list[str]:
    """Labels at one end of the region only, along the axis on which they reach furthest."""
    h, w = material.footage.roi.shape
    spans = [np.percentile(states[:, axis], [2, 98]) / side for axis, side in ((X, w), (Y, h))]
    low, high = max(spans, key=lambda span: span[1] - span[0])
    if high - low >= LEAST_COVERED:
        return []
    axis = ("width", "height")[int(np.argmax([span[1] - span[0] for span in spans]))]
    return [
        f"labels lie in {low:.0%} to {high:.0%} of the region's {axis} only: label every lump from where it "
        "comes into the region until it is gone"
    ]


def _sizes(material: Material, learned: Learned) -> list[str]:
    relative = relative_sizes(material, learned)
    if len(relative) < 3 or max(relative) / min(relative) >= LEAST_SIZE_RATIO:
        return []
    return [
        f"all lumps are of nearly the same size for their row ({min(relative):.2f} to {max(relative):.2f} of the "
        "expected): label smaller and larger ones too, or others may be missed"
    ]


def relative_sizes(material: Material, learned: Learned) -> list[float]:
    """Size of each lump against what its rows expect, as the median over its boxes."""
    height = float(material.footage.roi.shape[0])
    profile = learned.profile.scaled(height)
    out = []
    for lump in material.lumps:
        boxes = np.concatenate([track.boxes for track in lump.tracks]) if lump.tracks else np.empty((0, 4))
        if len(boxes) == 0:
            continue
        expected = profile.at(boxes[:, 1])[0][:, 2:].sum(axis=1)
        out.append(float(np.exp(0.5 * np.median(np.log(boxes[:, 2] * boxes[:, 3]) - expected))))
    return out


def _short(material: Material) -> list[str]:
    least = SHORT_S / material.footage.interval_s
    short = sum(sum(len(track.frames) for track in lump.tracks) < least for lump in material.lumps)
    if 2 * short <= len(material.lumps):
        return []
    return [
        f"{short} of {len(material.lumps)} lumps are labelled for less than {SHORT_S:g} s: label every frame in "
        "which a lump is at least half visible"
    ]
