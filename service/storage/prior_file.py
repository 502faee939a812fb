"""A prior as a file: what training learned, bound to one camera and ROI.

    lumpwatch-prior 1 <sha256 of the rest> <bytes of the rest> <newline>
    a NumPy .npz archive: the arrays, and `meta`, a JSON object

The first line makes truncation and corruption visible before anything is parsed. Arrays are read
without pickle, so that a foreign file cannot run code.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, model_validator

from lumpwatch.models.jdt.density import COMPONENTS, GridDensity
from lumpwatch.models.jdt.motion_prior import VELOCITY_BINS, CellVelocities
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning.learned import HistogramFit, Learned, LumpFit
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import fit_arrays, tracker_arrays
from lumpwatch.service.storage.arrays import load_arrays, within
from lumpwatch.service.storage.checksummed import SealError, seal, unseal

FORMAT = 1
MAX_BYTES = 64 << 20
_MOST_MODELS = 32
_MOST_KNOTS = 10_000
_MOST_TEXT = 10_000
_SINCE, _UNTIL = datetime(2000, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
_ASPECT_TOLERANCE = 0.01


class PriorError(LumpwatchError):
    """A prior cannot be used; the text says which and why."""


class PriorMeta(BaseModel):
    """The description of a prior."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str
    roi: str
    created: datetime
    polygon: tuple[tuple[float, float], ...]
    aspect: float
    """Width of the pictures over their height."""
    source: str
    """Names of the training videos, without their folders."""
    frames: int
    """Frames that training used."""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        """What is stored is shown to people and reckoned with, so it must be what a training can have written."""
        texts = (self.camera, self.roi, self.source)
        if not all(text.isprintable() and len(text) <= _MOST_TEXT for text in texts):
            raise ValueError("names cannot be printed")
        if self.created.tzinfo is None or not _SINCE <= self.created < _UNTIL:
            raise ValueError("the time is none")
        within("aspect", self.aspect, 0.05, 20.0)
        if not 3 <= len(self.polygon) <= 1000:
            raise ValueError("the polygon has no corners")
        within("polygon", self.polygon, -0.01, 1.01)
        within("frames", self.frames, 0, 1e12)
        return self


@dataclass(frozen=True, slots=True)
class Prior:
    """A prior with its identity."""

    meta: PriorMeta
    learned: Learned
    version: int = 0
    """Number under which the store keeps it; 0 before it is stored."""

    def check_fits(self, roi: RoiConfig, width: int, height: int) -> None:
        """Raises PriorError where ROI or picture are not those of the training."""
        same = len(self.meta.polygon) == len(roi.polygon) and np.allclose(
            self.meta.polygon, roi.polygon, atol=1e-6
        )
        if not same:
            raise PriorError(f"prior of roi {roi.id}: was trained for another polygon; train again")
        if abs(width / height / self.meta.aspect - 1.0) > _ASPECT_TOLERANCE:
            raise PriorError(
                f"prior of roi {roi.id}: was trained on pictures of another shape "
                f"({self.meta.aspect:.3f} wide to 1 high, now {width / height:.3f}); train again"
            )

    def with_version(self, version: int) -> Prior:
        """The same prior under a version number."""
        return replace(self, version=version)


def encode_prior(prior: Prior) -> bytes:
    """The bytes of a prior file; the same prior gives the same bytes."""
    learned = prior.learned
    fit = learned.likelihood
    kind: Literal["lump", "histogram"] = "lump" if isinstance(fit, LumpFit) else "histogram"
    meta = prior.meta.model_dump(mode="json") | {
        "models": learned.models,
        "interval_s": learned.interval_s,
        "tracks": learned.tracks,
        "components": learned.density.components,
        "likelihood": kind,
        "channel": fit.channel if isinstance(fit, HistogramFit) else None,
    }
    arrays: dict[str, NDArray[Any]] = {
        "rates": learned.rates,
        "velocity_noise": learned.velocity_noise,
        "joint": learned.joint,
        "births": learned.births,
        "label_counts": learned.label_counts,
        "density_origin": learned.density.origin,
        "density_step": learned.density.step,
        "density_values": learned.density.values,
        "profile_rows": np.array([learned.profile.first_row, learned.profile.row_step]),
        "profile_mean": learned.profile.mean,
        "profile_spread": learned.profile.spread,
    }
    if np.isfinite(learned.profile.aspect_spread):
        arrays["profile_aspect"] = np.array([learned.profile.aspect_spread])
    arrays |= fit_arrays.encode_fit(fit)
    arrays |= tracker_arrays.encode_tracker(learned.tracker)
    if learned.birth_places is not None:
        arrays["birth_places"] = learned.birth_places
    if learned.cells is not None:
        arrays["cells"] = learned.cells.counts
        arrays["cells_scale"] = np.array([learned.cells.cell, learned.cells.fastest])
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(meta, sort_keys=True).encode(), dtype=np.uint8)
    np.savez(buffer, allow_pickle=False, meta=text, **arrays)
    return seal("prior", FORMAT, buffer.getvalue())


def decode_prior(content: bytes, name: str) -> Prior:
    """The prior in the bytes of a file; `name` stands for it in errors. Raises PriorError."""
    try:
        body = unseal("prior", FORMAT, content)
    except SealError as error:
        raise PriorError(f"{name}: {error}") from error
    try:
        arrays = load_arrays(body, MAX_BYTES)
        meta = json.loads(arrays.pop("meta").tobytes())
        learned = _learned(meta, arrays)
        known = {key: meta[key] for key in PriorMeta.model_fields}
        prior = Prior(PriorMeta.model_validate(known), learned)
    except fit_arrays.OutdatedError as error:
        raise PriorError(f"{name}: {error}") from error
    except Exception as error:
        # The checksum holds, so this is another program's file: whatever is wrong, it is not a prior.
        raise PriorError(
            f"{name}: the prior's content is not as expected ({type(error).__name__})"
        ) from error
    return prior


def _places(arrays: dict[str, NDArray[Any]]) -> NDArray[Any] | None:
    places = arrays.get("birth_places")
    if places is not None and (places.ndim != 2 or places.shape[1] != 2 or len(places) == 0):
        raise ValueError("birth places have another shape")
    return places


def _cells(arrays: dict[str, NDArray[Any]]) -> CellVelocities | None:
    if "cells" not in arrays:
        return None
    counts = arrays["cells"]
    if counts.ndim != 4 or 0 in counts.shape or counts.shape[2:] != (VELOCITY_BINS, VELOCITY_BINS):
        raise ValueError("cells have another shape")
    cell, fastest = arrays["cells_scale"]
    if not (cell > 0 and fastest > 0):
        raise ValueError("cells have no size")
    return CellVelocities(float(cell), float(fastest), counts)


def _aspect(arrays: dict[str, NDArray[Any]]) -> float:
    if "profile_aspect" not in arrays:
        return np.inf
    (aspect,) = arrays["profile_aspect"]
    if not aspect > 0:
        raise ValueError("the aspect has no spread")
    return float(aspect)


_BOUNDS: dict[str, tuple[float, float]] = {
    "rates": (-1e3, 1e3),
    "velocity_noise": (0.0, 1e3),
    "joint": (0.0, 1e9),
    "births": (0.0, 1e9),
    "label_counts": (0.0, 2.0**53),
    "density_origin": (-1e4, 1e4),
    "density_step": (1e-9, 1e4),
    "density_values": (0.0, 1e12),
    "profile_rows": (-1e3, 1e3),
    "profile_mean": (-1e3, 1e3),
    "profile_spread": (0.0, 1e3),
    "birth_places": (-1e3, 1e3),
    "cells": (0.0, 1e12),
    "cells_scale": (1e-9, 1e6),
}
"""Far beyond what a region can teach; lengths are ROI heights, so a lump that moves moves by some of them a second."""


def _check_models(models: Any) -> None:
    named = isinstance(models, list) and all(isinstance(name, str) and name.isprintable() for name in models)
    if not named or not 1 <= len(models) <= _MOST_MODELS or len(set(models)) < len(models):
        raise ValueError("the models have no names")


def _learned(meta: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Learned:
    """Arrays back to their places; raises ValueError where a shape or number cannot be right."""
    m = len(meta["models"])
    density = GridDensity(
        tuple(int(c) for c in meta["components"]),
        arrays["density_origin"],
        arrays["density_step"],
        arrays["density_values"],
    )
    first, step = arrays["profile_rows"]
    fit = fit_arrays.decode_fit(arrays, lump=meta["likelihood"] == "lump", channel=meta["channel"])
    knots, axes = len(arrays["profile_mean"]), len(density.components)
    shapes: dict[str, tuple[int, ...]] = {
        "profile_rows": (2,),
        "profile_mean": (knots, 4),
        "profile_spread": (knots, 4),
        "density_origin": (axes,),
        "density_step": (axes,),
        "rates": (m, 2),
        "velocity_noise": (m,),
        "joint": (m, m),
        "births": (m,),
        "label_counts": (m,),
    }
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise ValueError(f"{key} has shape {arrays[key].shape}")
    if density.components not in COMPONENTS.values() or knots < 1:
        raise ValueError("unknown components or an empty profile")
    if density.values.shape[0] != m or density.values.ndim != 1 + axes or min(density.values.shape[1:]) < 2:
        raise ValueError("density does not fit the models")
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise ValueError("not finite")
    _check_models(meta["models"])
    if knots > _MOST_KNOTS:
        raise ValueError("more rows than a picture has")
    for key, (low, high) in _BOUNDS.items():
        if key in arrays:
            within(key, arrays[key], low, high)
    for key in ("joint", "births"):
        if not arrays[key].sum() > 0:
            raise ValueError(f"{key} is zero")
    within("row step", step, 1e-9, 1e3)
    within("interval_s", meta["interval_s"], 1e-4, 60.0)
    within("tracks", meta["tracks"], 0, 1e9)
    return Learned(
        models=tuple(meta["models"]),
        rates=arrays["rates"],
        velocity_noise=arrays["velocity_noise"],
        joint=arrays["joint"],
        interval_s=float(meta["interval_s"]),
        density=density,
        births=arrays["births"],
        profile=RowProfile(
            float(first), float(step), arrays["profile_mean"], arrays["profile_spread"], _aspect(arrays)
        ),
        likelihood=fit,
        birth_places=_places(arrays),
        cells=_cells(arrays),
        tracker=tracker_arrays.decode_tracker(arrays),
        label_counts=arrays["label_counts"],
        tracks=int(meta["tracks"]),
    )
