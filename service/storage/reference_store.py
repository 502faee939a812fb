"""One version of a camera's reference as a file: numbers and stills, with a checksum.

What a fit picture looks like by day and by night (`lumpwatch.models.picture`), and which camera and ROIs it is for.
"""

from __future__ import annotations

import errno
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from lumpwatch.models.picture.pattern import Pattern
from lumpwatch.models.picture.reference import Light
from lumpwatch.models.picture.region import Measure, RegionReference
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.arrays import load_arrays, within
from lumpwatch.service.storage.checksummed import SealError, seal, unseal
from lumpwatch.service.storage.versions import Versions

FORMAT = 1
MAX_BYTES = 16 << 20
_ASPECT_TOLERANCE = 0.01
_PATTERN = ("level_low", "level_high", "detail_low", "detail_high")


class BadReferenceError(LumpwatchError):
    """A reference cannot be used; the text says which and why."""


class ReferenceMeta(BaseModel):
    """The description of a reference."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str
    created: datetime
    aspect: float
    """Width of the pictures over their height."""
    polygons: dict[str, tuple[tuple[float, float], ...]]
    """The ROIs that it was learned for."""
    working_size_px: dict[str, int]
    """Their working sizes."""
    false_share: float
    """Share of the time for which footage like this is taken for unfit."""
    sources: dict[str, tuple[str, ...]]
    """Names of the recordings of each light, without their folders."""


@dataclass(frozen=True, slots=True)
class Reference:
    """A reference with its identity."""

    meta: ReferenceMeta
    lights: tuple[Light, ...]
    version: int = 0
    """Number under which the store keeps it; 0 before it is stored."""

    def check_fits(self, camera: CameraConfig, width: int, height: int) -> None:
        """Raises BadReferenceError where ROIs or picture are not those that it was learned for."""
        for roi in camera.rois:
            if roi.watches_mouth:
                continue
            polygon = self.meta.polygons.get(roi.id, ())
            same = len(polygon) == len(roi.polygon) and np.allclose(polygon, roi.polygon, atol=1e-6)
            if not same or self.meta.working_size_px.get(roi.id) != roi.working_size_px:
                raise BadReferenceError(
                    f"reference of camera {camera.id}: was learned for another roi {roi.id}; learn again"
                )
        if abs(width / height / self.meta.aspect - 1.0) > _ASPECT_TOLERANCE:
            raise BadReferenceError(
                f"reference of camera {camera.id}: was learned on pictures of another shape "
                f"({self.meta.aspect:.3f} wide to 1 high, now {width / height:.3f}); learn again"
            )


def encode(reference: Reference) -> bytes:
    """The bytes of a reference file; the same reference gives the same bytes."""
    arrays: dict[str, NDArray[Any]] = {}
    lights = []
    for i, light in enumerate(reference.lights):
        arrays[f"{i}_still"] = light.still
        regions = []
        for k, (roi, region) in enumerate(light.regions.items()):
            numbers = {
                "roi": roi,
                "mean": region.mean,
                "usual": dict(region.usual),
                "thresholds": dict(region.thresholds),
            }
            regions.append(numbers)
            for name in _PATTERN:
                arrays[f"{i}_{k}_{name}"] = getattr(region.pattern, name)
        lights.append({"name": light.name, "regions": regions})
    meta = {"meta": reference.meta.model_dump(mode="json"), "lights": lights}
    text = np.frombuffer(json.dumps(meta, sort_keys=True).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, meta=text, **arrays)
    return seal("reference", FORMAT, buffer.getvalue())


def decode(content: bytes, name: str) -> Reference:
    """The reference in the bytes of a file; `name` stands for it in errors. Raises BadReferenceError."""
    try:
        body = unseal("reference", FORMAT, content)
    except SealError as error:
        raise BadReferenceError(f"{name}: {error}") from error
    try:
        arrays = load_arrays(body, MAX_BYTES)
        described = json.loads(arrays.pop("meta").tobytes())
        lights = tuple(_light(i, light, arrays) for i, light in enumerate(described["lights"]))
        meta = ReferenceMeta.model_validate(described["meta"])
        _check(meta, lights)
    except Exception as error:
        # The checksum holds, so this is another program's file: whatever is wrong, it is no reference.
        raise BadReferenceError(
            f"{name}: the reference's content is not as expected ({type(error).__name__})"
        ) from error
    if not lights:
        raise BadReferenceError(f"{name}: the reference holds no light")
    return Reference(meta, lights)


_STILL_PX = (8, 640)
_THRESHOLDS: Mapping[Measure, tuple[float, float]] = {
    Measure.BRIGHT: (0.0, 255.0),
    Measure.SATURATED: (0.0, 2.0),
    Measure.SHARPNESS: (0.0, 10.0),
    Measure.STRUCTURE: (0.0, 10.0),
    Measure.STRANGE: (0.0, 2.0),
    Measure.ACTIVITY: (0.0, 255.0),
}
"""What can be measured at all: beyond it a picture would never be fit, or always."""


def _check(meta: ReferenceMeta, lights: tuple[Light, ...]) -> None:
    """Raises ValueError for what no learning can have written."""
    within("aspect", meta.aspect, 0.05, 20.0)
    within("false share", meta.false_share, 0.0, 1.0)
    for polygon in meta.polygons.values():
        within("polygon", polygon, -0.01, 1.01)
    for light in lights:
        if set(light.regions) != set(meta.polygons):
            raise ValueError("a light has other regions")
        within("size of the still", light.still.shape, *_STILL_PX)
        for region in light.regions.values():
            within("mean", region.mean, 0.0, 255.0)
            for measure, bounds in _THRESHOLDS.items():
                within(measure.value, region.thresholds[measure], *bounds)


def _light(i: int, content: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Light:
    """Numbers and arrays back to their places; raises ValueError where one cannot be right."""
    still = arrays[f"{i}_still"]
    if still.dtype != np.uint8 or still.ndim != 2:
        raise ValueError("the still is no picture")
    regions = {}
    for k, region in enumerate(content["regions"]):
        bounds = [arrays[f"{i}_{k}_{name}"] for name in _PATTERN]
        if any(bound.ndim != 1 or bound.shape != bounds[0].shape or not bound.size for bound in bounds):
            raise ValueError("the pattern has another shape")
        usual, thresholds = ({Measure(m): float(v) for m, v in region[key].items()} for key in _NUMBERS)
        numbers = [region["mean"], *usual.values(), *thresholds.values()]
        if set(thresholds) != set(Measure) or not np.isfinite(numbers).all():
            raise ValueError("thresholds are missing or not finite")
        regions[region["roi"]] = RegionReference(float(region["mean"]), usual, thresholds, Pattern(*bounds))
    return Light(content["name"], still, regions)


_NUMBERS = ("usual", "thresholds")


@dataclass(frozen=True, slots=True)
class FoundReference:
    """The reference to use, and what went wrong on the way to it."""

    reference: Reference | None
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReferenceStore:
    """The references below one folder: `<store>/references/<camera>/000001.reference …` and `current`."""

    root: Path
    keep: int = 10

    def versions(self, camera: str) -> Versions:
        """The versions of one camera."""
        return Versions(self.root / "references" / camera, ".reference", self.keep)

    def save(self, reference: Reference) -> Reference:
        """Store as the newest version and use it. Raises StoreError."""
        return replace(reference, version=self.versions(reference.meta.camera).save(encode(reference)))

    def current(self, camera: str) -> FoundReference:
        """The reference in use; a version that cannot be read falls back to the newest older one.

        Raises StoreError.
        """
        versions = self.versions(camera)
        candidates, problem = versions.candidates()
        problems = [] if problem is None else [problem]
        for version in candidates:
            path = versions.path(version)
            try:
                reference = decode(_read(path), str(path))
            except BadReferenceError as error:
                problems.append(str(error))
                continue
            if reference.meta.camera == camera:
                return FoundReference(replace(reference, version=version), tuple(problems))
            problems.append(f"{path}: belongs to camera {reference.meta.camera}, not to camera {camera}")
        return FoundReference(None, tuple(problems))


def _read(path: Path) -> bytes:
    try:
        return read_bounded(path, MAX_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise BadReferenceError(f"{path}: is larger than {MAX_BYTES >> 20} MiB") from error
        raise BadReferenceError(f"{path}: cannot be read ({error.strerror})") from error
