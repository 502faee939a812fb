"""`lumpwatch bench CONFIG`: what each camera takes of this machine, and how many such cameras it carries."""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from dataclasses import asdict
from pathlib import Path

from lumpwatch.service.capture import record
from lumpwatch.service.cli.camera_cost import ROUNDS, USABLE, Cost, measure_cost
from lumpwatch.service.cli.common import camera_of, progress
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import CameraConfig, load_config
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import PriorStore
from lumpwatch.service.threads import processor_count

NOT_MEASURED = (
    "memory (some 300 MB a camera), clips and stills of alarms, the console's pictures, priors in shadow, latency "
    "under load, reception of RTSP, and heat that slows a machine down after minutes"
)
"""What the figures leave out; said with them."""
_LOADED = 0.5
"""Load a processor from which the machine counts as busy."""


def bench(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if not 2.0 <= arguments.for_s <= 600.0:
        raise ConfigError(f"--for {arguments.for_s:g}s: expected 2s to 10m")
    config = load_config(arguments.config, secrets=arguments.video is None)
    cameras = (camera_of(config, arguments.camera),) if arguments.camera else config.cameras
    store = PriorStore(config.store.path, config.store.keep_priors)
    costs: dict[str, Cost] = {}
    notes: list[str] = []
    with tempfile.TemporaryDirectory(prefix="lumpwatch-bench-") as folder:
        for camera in cameras:
            clip = _clip(camera, arguments, Path(folder), notes)
            priors = {roi.id: store.current(camera.id, roi.id).prior for roi in camera.rois}
            with progress(f"measure {camera.id}", ROUNDS) as advance:
                costs[camera.id] = measure_cost(camera, priors, clip, arguments.for_s, advance)
    _tell(costs, notes, as_json=arguments.json)
    return 0


def _clip(camera: CameraConfig, arguments: argparse.Namespace, folder: Path, notes: list[str]) -> Path:
    """The file to measure on. Raises SourceError."""
    if arguments.video is not None:
        return Path(arguments.video)
    if camera.source.kind == "video":
        return camera.source.path
    path = folder / f"{camera.id}.mp4"
    with progress(f"record {camera.id}", round(arguments.for_s)) as advance:
        record(camera, path, arguments.for_s, lambda done_s: advance(round(done_s)))
    if camera.source.kind != "rtsp":
        notes.append(
            f"{camera.id}: its source sends no coded video; it was coded as H.264, as a camera would send it"
        )
    return path


def _tell(costs: dict[str, Cost], notes: list[str], *, as_json: bool) -> None:
    processors = processor_count()
    load = os.getloadavg()[0]
    if load > _LOADED * processors:
        notes.append(
            f"the machine is busy (load {load:.1f} on {processors} processors): CPU time changes little by that, "
            "but caches are shared; measure again when it is idle"
        )
    share = sum(cost.share for cost in costs.values())
    if as_json:
        tell_json(
            {
                "processors": processors,
                "machine": platform.machine(),
                "python": platform.python_version(),
                "load": round(load, 2),
                "usable": USABLE,
                "cameras": {
                    name: asdict(cost)
                    | {
                        "ratio": cost.ratio,
                        "processor_share": cost.share,
                        "carried": cost.carried(processors),
                    }
                    for name, cost in costs.items()
                },
                "machine_share": share / processors,
                "notes": notes,
                "not_measured": NOT_MEASURED,
            }
        )
        return
    lines = [line for name, cost in costs.items() for line in _lines(name, cost, processors)]
    lines += [
        f"cameras measured: {len(costs)}; together they take {100 * share / processors:.0f} % of the machine",
        "measured: decoding, cutting, the bus, judging, filtering and publishing states, all in one process"
        + (
            ""
            if all(cost.shared_memory for cost in costs.values())
            else "; frames went without shared memory"
        ),
        f"not measured: {NOT_MEASURED}",
        *notes,
    ]
    print("\n".join(lines))  # noqa: T201 - the answer


def _lines(name: str, cost: Cost, processors: int) -> list[str]:
    stages = ", ".join(f"{stage} {spent:.2f}" for stage, spent in cost.stages_ms.items())
    return [
        f"{name}: {cost.width}x{cost.height}, {cost.fps:.3g} frames a second, {cost.decided_hz:.3g} of them decided on",
        f"  CPU time a frame: {cost.frame_ms:.2f} ms, {cost.ratio:.2f} times bare decoding ({cost.decoding_ms:.2f} ms)",
        f"  of which {stages} ms",
        f"  {100 * cost.share:.1f} % of a processor: the {processors} here carry {cost.carried(processors)} such "
        f"cameras and keep {100 * (1 - USABLE):.0f} % free",
    ]
