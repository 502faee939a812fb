"""Learning a reference: recordings of a fit picture -> what is usual and from where on it is not fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from lumpwatch.models.picture.activity import Activity
from lumpwatch.models.picture.measures import PictureMeter
from lumpwatch.models.picture.reference import Light, thumbnail
from lumpwatch.models.picture.region import DEFAULTS, Measure, Sample, learn_region
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame, luma_of, working_luma
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Reference, ReferenceMeta

SHORT_S = 60.0
"""Footage that is shorter teaches too little; a warning says so."""
_MOST_STILLS = 300


class FootageError(LumpwatchError):
    """The footage does not teach what is needed; the text says what is missing."""


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording of a fit picture."""

    name: str
    frames: Iterable[Frame]


@dataclass(frozen=True, slots=True)
class LearnedReference:
    """A reference that is not stored yet, and what should be known of it."""

    reference: Reference
    warnings: tuple[str, ...]


class _Footage:
    """What is measured of one light's recordings."""

    def __init__(self, camera: CameraConfig) -> None:
        self._camera = camera
        self._size: tuple[int, int] | None = None
        self._rois: dict[str, tuple[Roi, PictureMeter]] = {}
        # A mouth that is blocked looks as it never did: that must not pass for a hidden one.
        self._belts = tuple(roi for roi in camera.rois if not roi.watches_mouth)
        self.clips: dict[str, list[list[Sample]]] = {roi.id: [] for roi in self._belts}
        self.stills: list[Image] = []
        self.seconds = 0.0

    @property
    def size(self) -> tuple[int, int]:
        return self._size or (1, 1)

    def read(self, recording: Recording, advance: Callable[[int], None]) -> None:
        """Measure a recording as it would be measured live. Raises FootageError."""
        quality = self._camera.quality
        activities = {roi: Activity(quality.window_s) for roi in self.clips}
        for samples in self.clips.values():
            samples.append([])
        first = last = float("-inf")
        for count, frame in enumerate(recording.frames, 1):
            advance(count)
            if frame.capture_s < last + 1.0 / quality.rate_hz - 1e-6:
                continue
            first, last = (frame.capture_s if count == 1 else first), frame.capture_s
            self._fit(frame, recording.name)
            for roi, (geometry, meter) in self._rois.items():
                gray = working_luma(frame, geometry)
                activity = activities[roi].add(frame.capture_s, gray)
                self.clips[roi][-1].append(Sample(frame.capture_s, meter.measure(gray), activity))
            self.stills.append(thumbnail(luma_of(frame)))
            if len(self.stills) > 2 * _MOST_STILLS:
                del self.stills[::2]
        if last > first:
            self.seconds += last - first

    def _fit(self, frame: Frame, name: str) -> None:
        size = frame.width, frame.height
        if self._size is None:
            try:
                for roi in self._belts:
                    geometry = make_roi(roi.polygon, *size, roi.working_size_px)
                    self._rois[roi.id] = geometry, PictureMeter(geometry.mask)
            except ValueError as error:
                raise FootageError(f"camera {self._camera.id}, roi {roi.id}: {error}") from error
            self._size = size
        elif size != self._size:
            raise FootageError(f"{name}: has another size than the recording before, {size[0]}x{size[1]}")


def learn_reference(
    camera: CameraConfig,
    recordings: Mapping[str, Sequence[Recording]],
    false_share: float,
    created: datetime,
    advance: Callable[[int], None] = lambda _: None,
) -> LearnedReference:
    """Learn from the recordings of each light (`day`, `night`). Raises FootageError and SourceError."""
    lights: list[Light] = []
    warnings: list[str] = []
    aspect = 0.0
    for name, some in recordings.items():
        footage = _Footage(camera)
        for recording in some:
            footage.read(recording, advance)
        try:
            regions = {
                roi: learn_region(clips, false_share, camera.quality.window_s)
                for roi, clips in footage.clips.items()
            }
        except ValueError as error:
            raise FootageError(f"{', '.join(recording.name for recording in some)}: {error}") from error
        here = footage.size[0] / footage.size[1]
        if aspect and abs(here / aspect - 1.0) > 0.01:
            raise FootageError(f"{some[0].name}: has another shape than the recordings by day")
        aspect = here
        still = np.median(np.stack(footage.stills), axis=0).astype(np.uint8)
        lights.append(Light(name, still, regions))
        warnings += _warnings(name, footage.seconds, lights[-1])
    meta = ReferenceMeta(
        camera=camera.id,
        created=created,
        aspect=aspect,
        polygons={roi.id: roi.polygon for roi in camera.rois if not roi.watches_mouth},
        working_size_px={roi.id: roi.working_size_px for roi in camera.rois if not roi.watches_mouth},
        false_share=false_share,
        sources={name: tuple(recording.name for recording in some) for name, some in recordings.items()},
    )
    return LearnedReference(Reference(meta, tuple(lights)), tuple(warnings))


def _warnings(light: str, seconds: float, learned: Light) -> list[str]:
    found = []
    if seconds < SHORT_S:
        found.append(f"{light}: only {seconds:.0f} s of footage; a few minutes in all weathers teach more")
    for roi, region in learned.regions.items():
        if region.thresholds[Measure.ACTIVITY] <= DEFAULTS[Measure.ACTIVITY]:
            found.append(
                f"{light}, roi {roi}: the picture stands still at times, so only one that is the same to the "
                "bit counts as frozen; set quality.frozen.entry_s above the longest stop, or switch it off"
            )
    return found
