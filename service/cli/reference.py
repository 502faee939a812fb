"""`lumpwatch reference`: learn what a camera's picture looks like when it is fit."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table

from lumpwatch.models.picture.region import Measure
from lumpwatch.service.capture import read_frames
from lumpwatch.service.cli.common import camera_of, progress
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import CameraConfig, load_config
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import Reference, ReferenceStore
from lumpwatch.service.training import Recording, learn_reference

_MEANINGS = (
    "bright: 95th percentile of the grey levels. saturated: share of pixels at the end of the scale. sharpness: fine "
    "over coarse structure.",
    "structure: structure over brightness in most tiles. strange: share of tiles that look otherwise than in this "
    "footage. activity: change against the last seconds.",
)
"""Of the measures, as `lumpwatch.models.picture.region.Measure` says it."""


def reference(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    store = ReferenceStore(config.store.path, config.store.keep_priors)
    if arguments.use is not None:
        return _use(store, camera.id, arguments.use, as_json=arguments.json)
    if not 1e-6 <= arguments.false_share <= 0.05:
        raise ConfigError("--false-share: must be within 0.000001 and 0.05")
    if not arguments.videos:
        raise ConfigError("reference needs at least one VIDEO by day")
    store.versions(camera.id).check_writable()
    with ExitStack() as stack:
        advance = stack.enter_context(progress("reading", None))
        lights = {"day": [_recording(camera, video) for video in arguments.videos]}
        if arguments.night:
            lights["night"] = [_recording(camera, video) for video in arguments.night]
        learned = learn_reference(camera, lights, arguments.false_share, datetime.now(UTC), advance)
    stored = store.save(learned.reference)
    for warning in learned.warnings:
        sys.stderr.write(f"lumpwatch: warning: {warning}\n")
    if arguments.json:
        tell_json(_record(stored, learned.warnings))
    else:
        _print(stored)
    return 0


def _recording(camera: CameraConfig, video: Path) -> Recording:
    frames, _ = read_frames(camera, video)
    return Recording(video.name, frames)


def _use(store: ReferenceStore, camera: str, version: int, *, as_json: bool) -> int:
    versions = store.versions(camera)
    if version not in versions.all():
        raise ConfigError(f"--use {version}: camera {camera} has no such version of its reference")
    versions.use(version)
    if as_json:
        found = store.current(camera).reference
        tell_json(None if found is None else _record(found, ()))
        return 0
    print(f"{camera}: reference version {version} is in use")  # noqa: T201
    return 0


def _record(stored: Reference, warnings: Sequence[str]) -> dict[str, object]:
    """What a program may want of it; `above` or `below` is from where on a picture is not fit."""
    return {
        "camera": stored.meta.camera,
        "version": stored.version,
        "warnings": list(warnings),
        "lights": {
            light.name: {
                roi: {
                    measure.value: {
                        "usual": float(region.usual[measure]),
                        "above" if measure.too_large else "below": float(region.thresholds[measure]),
                    }
                    for measure in Measure
                }
                for roi, region in light.regions.items()
            }
            for light in stored.lights
        },
    }


def _print(stored: Reference) -> None:
    table = Table(title=f"{stored.meta.camera}: reference version {stored.version}")
    for heading in ("light", "roi", "measure", "usual", "not fit"):
        table.add_column(heading)
    for light in stored.lights:
        for roi, region in light.regions.items():
            for measure in Measure:
                sign = "above" if measure.too_large else "below"
                table.add_row(
                    light.name,
                    roi,
                    measure.value,
                    f"{region.usual[measure]:.3g}",
                    f"{sign} {region.thresholds[measure]:.3g}",
                )
    console = Console(markup=False)
    console.print(table)
    for line in _MEANINGS:
        console.print(line, style="dim", highlight=False)
