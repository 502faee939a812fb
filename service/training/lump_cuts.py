"""Cuts of labelled lumps, with which proof tests show what the site's own lumps look like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.state import H, W, X, Y
from lumpwatch.service.core import LARGEST_PX, MARGIN, LumpCut, tone_of
from lumpwatch.service.training.cross_validation import Validation, name_of
from lumpwatch.service.training.dataset import Lump, Material

MOST = 8
_LEAST_PX = 8

Array = NDArray[np.float64]


def cut_lumps(material: Material, validation: Validation | None, most: int = MOST) -> tuple[LumpCut, ...]:
    """At most so many of the labelled lumps, the hardest of the cross-validation first, the others spread evenly.

    Left out are those of which no picture shows all: not beyond the working picture, nor behind another label.
    """
    cuts = [cut for lump in _ranked(material, validation) if (cut := _cut(material, lump)) is not None]
    kept = np.unique(np.linspace(0, len(cuts) - 1, min(most, len(cuts))).round().astype(int))
    cuts = [cuts[k] for k in kept]
    ranks = [] if validation is None else [name_of(material, one.lump) for one in validation.hardest]
    if cuts and cuts[0].name in ranks:
        which = (
            "the hardest" if cuts[0].name == ranks[0] else "the hardest of those that a picture shows whole"
        )
        cuts[0] = replace(cuts[0], name=f"{cuts[0].name}, {which}")
    return tuple(cuts)


def _ranked(material: Material, validation: Validation | None) -> list[Lump]:
    judged = [] if validation is None else [one.lump for one in validation.hardest]
    known = {(lump.clip, lump.id) for lump in judged}
    return [*judged, *(lump for lump in material.lumps if (lump.clip, lump.id) not in known)]


def _cut(material: Material, lump: Lump) -> LumpCut | None:
    """The lump where it is largest; None where no picture shows all of it."""
    best: tuple[float, int, Array] | None = None
    for k, (view, moment) in enumerate(zip(material.footage.views, material.footage.moments, strict=True)):
        if moment.clip != lump.clip or lump.id not in moment.tracks:
            continue
        boxes = np.asarray(view.objects[:, [X, Y, W, H]], np.float64)
        own = moment.tracks.index(lump.id)
        box = boxes[own]
        area = float(box[2] * box[3])
        if (best is None or area > best[0]) and _alone(
            box, np.delete(boxes, own, axis=0), view.view.gray.shape
        ):
            best = area, k, box
    if best is None:
        return None
    gray = material.footage.views[best[1]].view.gray
    left, top, right, bottom = _window(best[2]).round().astype(int)
    picture = gray[top:bottom, left:right]
    if (shrink := LARGEST_PX / max(picture.shape)) < 1.0:
        sides = [max(1, int(side * shrink)) for side in picture.shape[::-1]]
        picture = np.asarray(cv2.resize(picture, sides, interpolation=cv2.INTER_AREA), np.uint8)
    x, y, w, h = (float(value) for value in best[2] / gray.shape[0])
    return LumpCut(name_of(material, lump), picture.copy(), (x, y, w, h), tone_of(gray))


def _window(box: Array) -> Array:
    """Left, top, right and bottom of what is cut for a box (centre and size), px."""
    reach = (0.5 + MARGIN) * box[2:]
    return np.concatenate([box[:2] - reach, box[:2] + reach])


def _alone(box: Array, others: Array, shape: Sequence[int]) -> bool:
    left, top, right, bottom = _window(box)
    inside = left >= 0 and top >= 0 and right <= shape[1] and bottom <= shape[0]
    large = min(box[2:]) >= _LEAST_PX
    apart = np.abs(others[:, :2] - box[:2]) >= (0.5 + MARGIN) * box[2:] + 0.5 * others[:, 2:]
    return bool(inside and large and apart.any(axis=1).all())
