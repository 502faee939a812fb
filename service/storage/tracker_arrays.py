"""What a tracker learned as a part of a prior file, and back."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning import ForegroundChoice, Noise, TrackerFit
from lumpwatch.models.trackers.imm_pf import LinearSize
from lumpwatch.models.trackers.scene import EmptyScene

Arrays = dict[str, NDArray[Any]]
_KINDS: tuple[Literal["mixture", "statistical"], ...] = ("mixture", "statistical")


def encode_tracker(fit: TrackerFit | None) -> Arrays:
    """The arrays by name; none where no tracker was trained."""
    if fit is None:
        return {}
    arrays: Arrays = {
        "tracker_noise": np.array([fit.noise.position, fit.noise.velocity, fit.noise.acceleration])
    }
    if fit.size is not None:
        line = fit.size
        arrays["tracker_size"] = np.array(
            [line.slope, line.offset, line.aspect, line.first_row, line.last_row]
        )
    if fit.scene is not None:
        arrays |= {"tracker_scene": fit.scene.picture, "tracker_scene_spread": fit.scene.spread}
        if fit.scene.cover is not None:
            arrays["tracker_cover"] = fit.scene.cover
    if fit.foreground is not None:
        kind, threshold = _KINDS.index(fit.foreground.kind), fit.foreground.threshold
        arrays["tracker_foreground"] = np.array([kind, threshold])
    if fit.working_size_px is not None:
        arrays["tracker_working_size"] = np.array([fit.working_size_px])
    return arrays


def decode_tracker(arrays: Arrays) -> TrackerFit | None:
    """The fit, None where there is none. Raises KeyError or ValueError where it cannot be right."""
    if "tracker_noise" not in arrays:
        return None
    position, velocity, acceleration = (float(level) for level in arrays["tracker_noise"])
    if min(position, velocity, acceleration) <= 0.0:
        raise ValueError("noise must be positive")
    size = scene = foreground = working = None
    if "tracker_size" in arrays:
        size = LinearSize(*(float(value) for value in arrays["tracker_size"]))
        if size.aspect <= 0.0:
            raise ValueError("an aspect must be positive")
    if "tracker_scene" in arrays:
        picture, spread = arrays["tracker_scene"], arrays["tracker_scene_spread"]
        if picture.ndim != 3 or picture.shape[2] != 3 or spread.shape != picture.shape:
            raise ValueError(f"a scene of shape {picture.shape}")
        if picture.dtype != np.uint8 or spread.dtype != np.uint8:
            raise ValueError("a scene holds bytes")
        cover = arrays.get("tracker_cover")
        if cover is not None and (cover.shape != picture.shape[:2] or cover.dtype != np.uint8):
            raise ValueError(f"a cover of shape {cover.shape}")
        scene = EmptyScene(picture, spread, cover)
    if "tracker_foreground" in arrays:
        kind, threshold = arrays["tracker_foreground"]
        foreground = ForegroundChoice(_KINDS[int(kind)], float(threshold))
    if "tracker_working_size" in arrays:
        (working,) = (int(value) for value in arrays["tracker_working_size"])
        if not 48 <= working <= 1920:
            raise ValueError(f"a working size of {working}")
    noise = Noise(position, velocity, acceleration)
    return TrackerFit(noise=noise, size=size, scene=scene, foreground=foreground, working_size_px=working)
