"""The priors of a region: what there is, what runs in shadow and how it does, and what people do about it.

What is done is what `lumpwatch priors` does, noted with the name of who did it in `<store>/console/deeds.jsonl`.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import summary
from lumpwatch.service.storage import PriorError, PriorStore, ReferenceStore, read_state


class PriorDeed(BaseModel):
    """What is done to a version of a prior."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    do: Literal["shadow", "promote", "drop", "use"]
    """`shadow`: try it beside the prior in use; `promote`, `drop`: end the trial with or without its use; `use`: go
    back to it, 0 being the stated defaults."""
    version: int = Field(ge=0, le=10_000_000)


class Deeds:
    """Who did what: a file of one line a deed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def note(self, actor: str, did: str, camera: str, roi: str = "") -> None:
        """Add a line. Raises LumpwatchError: what cannot be noted is said, but is done."""
        line = {
            "time": datetime.now(UTC).isoformat(),
            "actor": actor,
            "camera": camera,
            "roi": roi,
            "did": did,
        }
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        except OSError as error:
            raise LumpwatchError(f"done, but not noted: {self._path} ({error.strerror})") from error

    def latest(self, camera: str, roi: str, most: int = 20) -> list[dict[str, Any]]:
        """The latest deeds on a region, newest first."""
        try:
            lines = self._path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError):
            return []
        found = (_deed(line) for line in reversed(lines))
        return [deed for deed in found if deed.get("camera") == camera and deed.get("roi") in ("", roi)][
            :most
        ]


def _deed(line: str) -> dict[str, Any]:
    """A line of the file; empty where it is none, such as one that a power cut left half written."""
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def listing(store: PriorStore, camera: str, roi: str) -> dict[str, Any]:
    """All versions, newest first, and the trial."""
    current = store.current(camera, roi)
    in_use = current.prior.version if current.prior else 0
    shadow = store.shadow_pointer(camera, roi)
    rows = [_version(store, camera, roi, version) for version in reversed(store.versions(camera, roi))]
    for row in rows:
        row["state"] = (
            "in use" if row["version"] == in_use else "in shadow" if row["version"] == shadow else ""
        )
    state = read_state(store, camera, roi) if shadow is not None else None
    trial = None
    if shadow is not None:
        counted = state if state is not None and state.version == shadow else None
        trial = {
            "version": shadow,
            "lines": list(summary(counted)) if counted else [],
            "counts": json.loads(counted.line()) if counted else None,
        }
    return {"in_use": in_use, "problems": list(current.problems), "versions": rows, "trial": trial}


def act(store: PriorStore, camera: str, roi: str, deed: PriorDeed) -> str:
    """Do it; gives what was done in words. Raises PriorError, StoreError."""
    match deed.do:
        case "shadow":
            store.set_shadow(camera, roi, deed.version)
            return f"version {deed.version} runs in shadow"
        case "promote":
            before = store.current(camera, roi).prior
            store.promote(camera, roi, deed.version)
            return (
                f"version {deed.version} is promoted; before it was {_named(before.version if before else 0)}"
            )
        case "drop":
            store.drop_shadow(camera, roi, deed.version)
            return f"version {deed.version} no longer runs in shadow"
        case "use":
            if deed.version == 0:
                store.use_defaults(camera, roi)
            else:
                store.use(camera, roi, deed.version)
            return f"{_named(deed.version)} in use"


def references(store: ReferenceStore, camera: str) -> dict[str, Any]:
    """The versions of a camera's reference, and from where on the one in use takes a picture for unfit."""
    found = store.current(camera).reference
    limits = [
        {
            "light": light.name,
            "roi": roi,
            "measure": measure.value,
            "usual": float(region.usual[measure]),
            "sign": "above" if measure.too_large else "below",
            "unfit": float(limit),
        }
        for light in (found.lights if found else ())
        for roi, region in light.regions.items()
        for measure, limit in region.thresholds.items()
    ]
    versions = list(reversed(store.versions(camera).all()))
    return {"versions": versions, "in_use": found.version if found else None, "limits": limits}


def use_reference(store: ReferenceStore, camera: str, version: int) -> str:
    """Go back to a version of a reference; gives what was done in words. Raises KeyError, StoreError."""
    versions = store.versions(camera)
    if version not in versions.all():
        raise KeyError(f"reference version {version}")
    versions.use(version)
    return f"reference version {version} is in use"


def _version(store: PriorStore, camera: str, roi: str, version: int) -> dict[str, Any]:
    row: dict[str, Any] = {
        "version": version,
        "report": store.report_path(camera, roi, version).is_file(),
        "untried": store.untried(camera, roi, version),
    }
    try:
        prior = store.load(camera, roi, version)
    except PriorError as error:
        return {**row, "refused": str(error)}
    return {
        **row,
        "created": prior.meta.created.isoformat(),
        "source": prior.meta.source,
        "lumps": prior.learned.tracks,
        "models": list(prior.learned.models),
    }


def _named(version: int) -> str:
    return f"version {version} is" if version else "the stated defaults are"
