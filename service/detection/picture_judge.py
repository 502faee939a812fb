"""Who judges the pictures of a channel: where its region lies now, and whether they are fit."""

from __future__ import annotations

from typing import Protocol

from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.core import Detection, PictureQuality


class PictureJudge(Protocol):
    """Knows where a region lies and whether its picture is fit; `CameraQuality` does so live."""

    def placed(self, roi_id: str, roi: Roi, width: int, height: int) -> tuple[Roi, tuple[int, int]]:
        """The region where it lies now, and by how many pixels of the picture it was moved."""

    def observe(self, roi: str, gray: Image, time_s: float) -> None:
        """A new working picture (h, w)."""

    def strangers(self, roi: str, detection: Detection, time_s: float) -> tuple[int, ...]:
        """Identities of the objects in that picture that are not on the belt, before the region was moved."""

    def filtered(self, roi: str, detection: Detection, time_s: float) -> None:
        """What the filter made of that picture."""

    def current(self, roi: str) -> PictureQuality:
        """What is known of the picture now."""


class EveryPictureFit:
    """A judge that takes every picture for fit, and the region's place from others."""

    def __init__(self) -> None:
        self.offset_px = (0, 0)
        """How far the region was moved along with the camera."""

    def placed(self, roi_id: str, roi: Roi, width: int, height: int) -> tuple[Roi, tuple[int, int]]:
        """At the offset that was set."""
        x, y = self.offset_px
        return roi.at(roi.x + x, roi.y + y), (x, y)

    def observe(self, roi: str, gray: Image, time_s: float) -> None:
        """Nothing."""

    def strangers(self, roi: str, detection: Detection, time_s: float) -> tuple[int, ...]:
        """None."""
        return ()

    def filtered(self, roi: str, detection: Detection, time_s: float) -> None:
        """Nothing."""

    def current(self, roi: str) -> PictureQuality:
        """Fit."""
        return PictureQuality(offset_px=self.offset_px)
