"""Changes of the configuration file: shown as a difference, checked as `lumpwatch check` would, written whole.

Comments and layout survive (ruamel's round trip). The old file is kept beside the new one. A change that was made
to another text than the one that the engineer saw is refused.
"""

from __future__ import annotations

import difflib
import hashlib
import io
import json
import os
import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.util import load_yaml_guess_indent

from lumpwatch.service.config import CalibrationConfig, JpdaConfig, load_config, parse_config, read_text
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.storage import replace_file

_GRID = 8
_ZONES = ("entries", "exits")
_CHANGED = ("polygon", "points", "points_mm", "lip", "limit_mm", *_ZONES)
_MOST_ZONES = 16


class EditError(LumpwatchError):
    """A change of the configuration that is not accepted; the text says why."""


class ConflictError(LumpwatchError):
    """The file has changed meanwhile."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A changed configuration that is valid."""

    text: str
    diff: list[str]
    fit: dict[str, Any] | None
    """How well the calibration fits, with the belt's grid in relative picture coordinates."""


def fingerprint(text: str) -> str:
    """Tells one text of the file from another."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def region_of(path: Path, camera: str, roi: str) -> dict[str, Any]:
    """The region as the file has it now, with the fingerprint of the text. Raises ConfigError, KeyError."""
    text = read_text(path)
    found = load_config(path).camera(camera).roi(roi)
    told = None if found.calibration is None else json.loads(found.calibration.model_dump_json())
    zones = None
    if isinstance(found.detector, JpdaConfig):
        low, extent = _bounds(found.polygon)
        zones = {
            name: [
                (low + np.array(zone) * extent).round(4).tolist() for zone in getattr(found.detector, name)
            ]
            for name in _ZONES
        }
    return {"base": fingerprint(text), "polygon": found.polygon, "calibration": told, "zones": zones}


def propose(path: Path, camera: str, roi: str, given: dict[str, Any], size: tuple[int, int]) -> Proposal:
    """The file with another region; `given` may have polygon, lip, points with points_mm, limit_mm, entries, exits.
    Zones come in coordinates of the picture; in the file they are relative to the region.

    Raises EditError naming what is wrong, ConflictError where the file is not the one of `given["base"]`.
    """
    text = read_text(path)
    if given.get("base") != fingerprint(text):
        raise ConflictError(f"{path.name} has changed meanwhile: load the page again")
    if unknown := set(given) - {"base", "size", *_CHANGED}:
        raise EditError(f"{min(unknown)[:40]}: is no part of a region that is edited here")
    try:
        changed = _changed(text, camera, roi, given)
        config = parse_config(changed, path.name, os.environ, path.parent)
    except (ConfigError, YAMLError) as error:
        raise EditError(str(error)) from error
    calibration = config.camera(camera).roi(roi).calibration
    fit = None
    if calibration is not None and calibration.points:
        fit = _fit(calibration, size)
    old, new = text.splitlines(), changed.splitlines()
    return Proposal(changed, list(difflib.unified_diff(old, new, "now", "then", lineterm="", n=2)), fit)


def write(path: Path, proposal: Proposal, actor: str) -> Path:
    """Put the change in place; gives the copy of the old file. Raises EditError."""
    now = datetime.now(UTC)
    kept = path.with_name(f"{path.name}.{now:%Y%m%dT%H%M%S%f}")
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        replace_file(kept, path.read_bytes(), mode)
        replace_file(path, proposal.text.encode(), mode)
        with path.with_name(f"{path.name}.changes.jsonl").open("a", encoding="utf-8") as log:
            line = {"time": now.isoformat(), "actor": actor, "kept": kept.name, "diff": proposal.diff}
            log.write(json.dumps(line) + "\n")
    except OSError as error:
        raise EditError(f"{path}: cannot be written ({error.strerror})") from error
    return kept


def _changed(text: str, camera: str, roi: str, given: dict[str, Any]) -> str:
    _, indent, offset = load_yaml_guess_indent(text)
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096
    yaml.indent(mapping=2, sequence=indent or 2, offset=offset or 0)
    tree = yaml.load(text)
    found = next(one for one in tree["cameras"] if one["id"] == camera)
    region = next(one for one in found["rois"] if one["id"] == roi)
    if "polygon" in given:
        _put(region, "polygon", _pairs(given["polygon"], "polygon"))
    for name in _ZONES:
        if name in given:
            if region.get("detector", {}).get("kind") != "jpda":
                raise EditError(f"{name}: only the detector jpda has zones")
            low, extent = _bounds(region["polygon"])
            _put(region["detector"], name, _zones(given[name], name, low, extent))
    inside = {name: given[name] for name in ("points", "points_mm", "lip", "limit_mm") if given.get(name)}
    if inside:
        if region.get("calibration") is None:
            region["calibration"] = CommentedMap()
        for name, value in inside.items():
            _put(region["calibration"], name, value if name == "limit_mm" else _pairs(value, name))
    out = io.StringIO()
    yaml.dump(tree, out)
    return out.getvalue()


def _put(holder: CommentedMap, name: str, value: Any) -> None:
    """Set a value; one that is equal stays as it was written, and a comment behind it stays too."""
    if holder.get(name) != value:
        holder[name] = value


def _pairs(value: Any, name: str) -> CommentedSeq:
    """Pairs of numbers on one line. Raises EditError."""
    if not isinstance(value, list) or len(value) > 64:
        raise EditError(f"{name}: is not a list of at most 64 points")
    rows = CommentedSeq()
    rows.fa.set_flow_style()
    for pair in value:
        if not isinstance(pair, list) or len(pair) != 2 or not all(type(v) in (int, float) for v in pair):
            raise EditError(f"{name}: a point is two numbers")
        row = CommentedSeq([round(float(v), 4) for v in pair])
        row.fa.set_flow_style()
        rows.append(row)
    return rows


def _bounds(polygon: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least corner and extent of the box around a polygon."""
    corners = np.array([list(point) for point in polygon], float)
    low = corners.min(axis=0)
    return low, np.maximum(corners.max(axis=0) - low, 1e-6)


def _zones(value: Any, name: str, low: NDArray[np.float64], extent: NDArray[np.float64]) -> CommentedSeq:
    """Zones relative to the region's box; what reaches beyond it is cut off. Raises EditError."""
    if not isinstance(value, list) or len(value) > _MOST_ZONES:
        raise EditError(f"{name}: is not a list of at most {_MOST_ZONES} zones")
    zones = CommentedSeq()
    zones.fa.set_flow_style()
    for zone in value:
        corners = np.array([[*pair] for pair in _pairs(zone, name)], float).reshape(-1, 2)
        zones.append(_pairs(np.clip((corners - low) / extent, 0.0, 1.0).tolist(), name))
    return zones


def _fit(calibration: CalibrationConfig, size: tuple[int, int]) -> dict[str, Any]:
    """How well the points fit, and lines of the belt through them. Raises EditError."""
    from lumpwatch.models.plane import fit_plane  # loads SciPy, which only a calibration needs

    scale = np.array(size, float)
    pixels, places = np.array(calibration.points) * scale, np.array(calibration.points_mm)
    try:
        plane = fit_plane(pixels, places, calibration.error_px, size, np.array(calibration.lip) * scale)
    except ValueError as error:
        raise EditError(str(error)) from error
    to_picture, _ = cv2.findHomography(places, pixels)
    low, high = places.min(axis=0), places.max(axis=0)
    lines = []
    for i in range(_GRID + 1):
        at = low + (high - low) * i / _GRID
        for ends in ([[at[0], low[1]], [at[0], high[1]]], [[low[0], at[1]], [high[0], at[1]]]):
            seen = cv2.perspectiveTransform(np.array([ends]), to_picture)[0] / scale
            lines.append(seen.round(4).tolist())
    return {"missed_px": round(plane.missed_px, 2), "view_deg": round(plane.view_deg, 1), "grid": lines}
