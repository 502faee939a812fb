"""Which lump a proof test shows, and how large: the site's labelled ones in turn, the hardest first."""

from __future__ import annotations

import logging
from base64 import b64encode
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.plane import BeltPlane, measure, side_of
from lumpwatch.service.core import LumpCut
from lumpwatch.service.protocol import CutPicture, Outcome, ProofResult
from lumpwatch.service.storage import LumpCutError, PriorStore

log = logging.getLogger(__name__)

_OVERSIZE = 1.5
"""Diameter of a drawn lump over the limit of a calibrated ROI."""
_LEAST_OVERSIZE = 1.1
"""Of a labelled one: a smaller one raises no alarm, rightly."""


def stored_lumps(priors: PriorStore, camera: str, roi: str, version: int) -> tuple[LumpCut, ...]:
    """The labelled lumps that came with a version of a prior; none, with a warning, where they cannot be read."""
    try:
        return priors.lumps(camera, roi, version)
    except LumpCutError as error:
        log.warning("%s; the proof test draws its lump", error)
        return ()


def next_lump(cuts: Sequence[LumpCut], last: ProofResult | None) -> LumpCut | None:
    """The lump after that of the last judged test; None where there are none, and one is drawn.

    One that was missed is shown until it is found: the next, easier one would hide the failure.
    """
    names = [cut.name for cut in cuts]
    if not names:
        return None
    if last is None or last.lump not in names:
        return cuts[0]
    place = names.index(last.lump)
    return cuts[place if last.outcome is Outcome.FAILED else (place + 1) % len(cuts)]


def as_message(cut: LumpCut) -> CutPicture:
    """What the camera's process needs of it."""
    height, width = cut.picture.shape
    luma = b64encode(cut.picture.tobytes()).decode()
    return CutPicture(width=width, height=height, luma=luma, mean=cut.tone[0], spread=cut.tone[1])


def sides_on_belt(
    plane: BeltPlane, limit_mm: float | None, box: NDArray[np.float64] | None, x: float, y: float
) -> tuple[float, float] | None:
    """Width and height, px, of the lump at a place of the picture; None where the calibration does not say.

    `box` is the labelled lump where it was cut (left, top, width, height, px), None: the lump is drawn. A labelled
    one keeps its diameter on the belt, but is over the limit.
    """
    if limit_mm is None:
        return None
    diameter_mm, tall = _OVERSIZE * limit_mm, 1.0
    if box is not None:
        centre = np.concatenate([box[:2] + box[2:] / 2, box[2:]])
        found = measure(plane, centre, np.zeros(2), np.ones(6))
        if found is None:
            return None
        diameter_mm = max(found.equivalent_mm.value, _LEAST_OVERSIZE * limit_mm)
        tall = float(np.sqrt(box[3] / box[2]))
    side = _side(plane, x, y, diameter_mm)
    return None if side is None else (side / tall, side * tall)


def _side(plane: BeltPlane, x: float, y: float, diameter_mm: float) -> float | None:
    side = float(side_of(plane, np.array([[x, y]]), diameter_mm)[0])
    return side if np.isfinite(side) else None
