"""Lumps in confirmed clips that nobody boxed: what the new filter still takes for a lump where no label lies.

A clip of a false alarm is confirmed as one by what raised it; a lump elsewhere in it may have been missed, and would be
learned as background. The filter was taught just that, so what it finds all the same is worth a look; what it does not
find may be there nevertheless.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.learning import Learned
from lumpwatch.models.state import H, W, X, Y
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.training.dataset import Material
from lumpwatch.service.training.watching import watch

LEAST_S = 0.5
"""How long something must be followed without a label on it."""
_OVERLAP = 0.1


@dataclass(frozen=True, slots=True)
class Unboxed:
    """Something followed like a lump where no label lies."""

    clip: int
    first_frame: int
    """From 1."""
    lasts_s: float
    existence: float
    box: tuple[float, float, float, float]
    """x, y, w, h in pixels of the whole picture, at its first frame."""

    def words(self, material: Material) -> str:
        """One line for a person."""
        x, y, w, h = (round(value) for value in self.box)
        return (
            f"{material.clips[self.clip].name}: from frame {self.first_frame} on ({x} {y} {w} {h}, x y w h) something "
            f"is followed like a lump for {self.lasts_s:.1f} s, and no label lies on it: if it is one, box it and "
            "refine anew, or the filter is taught to overlook it"
        )


def unboxed(
    roi: RoiConfig, material: Material, learned: Learned, clips: Collection[int]
) -> tuple[Unboxed, ...]:
    """What stands in these clips, by index, with an existence that would raise the alarm and without a label on it.

    The longest of each clip, in the order of the clips.
    """
    begun: dict[tuple[int, int], tuple[int, float, NDArray[np.float64]]] = {}
    longest: dict[int, Unboxed] = {}
    for (view, moment), channel in watch(roi, material.footage, learned, lambda m: m.clip in clips):
        if channel.detection is None:
            continue
        labels = material.footage.roi.to_frame(view.objects[:, [X, Y, W, H]])
        for one in channel.detection.counted:
            box = np.array([[one.x, one.y, one.w, one.h]])
            on_label = len(labels) and bool((overlaps(box, labels) > _OVERLAP).any())
            key = (moment.clip, one.id)
            if on_label or one.existence < roi.alarm.raise_above:
                begun.pop(key, None)
                continue
            frame, since_s, first = begun.setdefault(key, (moment.frame, moment.time_s, box[0]))
            lasts_s = moment.time_s - since_s
            known = longest.get(moment.clip)
            if lasts_s >= LEAST_S and (known is None or lasts_s > known.lasts_s):
                x, y, w, h = map(float, first)
                longest[moment.clip] = Unboxed(moment.clip, frame, lasts_s, one.existence, (x, y, w, h))
    return tuple(longest[clip] for clip in sorted(longest))
