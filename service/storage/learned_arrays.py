"""What a region's filter knows as a description and arrays of a prior file, and back."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.density import COMPONENTS, GridDensity
from lumpwatch.models.jdt.motion_prior import VELOCITY_BINS, CellVelocities
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning.learned import HistogramFit, Learned, LumpFit
from lumpwatch.service.storage import fit_arrays, tracker_arrays
from lumpwatch.service.storage.arrays import within

_MOST_MODELS = 32
_MOST_KNOTS = 10_000


def encode_learned(learned: Learned) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What is described in words and numbers, and the arrays by name."""
    fit = learned.likelihood
    kind: Literal["lump", "histogram"] = "lump" if isinstance(fit, LumpFit) else "histogram"
    described = {
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
    return described, arrays


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


def decode_learned(meta: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Learned:
    """The reverse of `encode_learned`. Raises KeyError or ValueError where a shape or number cannot be right."""
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
