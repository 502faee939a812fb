"""Where a frame's time goes: the chain of one camera stage by stage, beside bare decoding; writes docs/results/cost.md.

`python -m tests.benchmarks cost`
"""

from __future__ import annotations

import os
import platform
import tempfile
from pathlib import Path

from lumpwatch.service.cli.camera_cost import ROUNDS, USABLE, Cost, measure_cost
from lumpwatch.service.cli.demo import CAMERA, demo_config
from lumpwatch.service.config import CameraConfig, parse_config
from tests.benchmarks.pipeline import FPS, make_video

PAGE = Path(__file__).parents[2] / "docs" / "results" / "cost.md"
SECONDS = 4.0
DOES = {
    "decode": "H.264 to luma, time stamps, numbering",
    "cut": "the part that the regions look at, halved where that is enough; the thumbnail of the whole",
    "publish": "header and pixels onto the bus",
    "take": "off the bus, checked",
    "cut regions": "to the working picture",
    "quality": "is the picture fit; has the camera moved",
    "feed": "does the belt run, how full is it",
    "filter": "net, likelihood, particles, sizes, alarm",
    "state": "the message of the region",
    "other": "threads of the bus, bookkeeping",
}


def run() -> dict[str, Cost]:
    """The demo's untrained region on 1080p: decided on as by default, and on every frame."""
    camera = parse_config(demo_config(Path("var"), 0)).camera(CAMERA)
    with tempfile.TemporaryDirectory() as folder:
        video = make_video(Path(folder) / "feed.mp4", SECONDS)
        return {
            name: measure_cost(_at(camera, rate), {}, video, SECONDS)
            for name, rate in (("by default", None), ("every frame", "all"))
        }


def _at(camera: CameraConfig, rate: str | None) -> CameraConfig:
    rois = tuple(roi.model_copy(update={"decide_hz": rate}) for roi in camera.rois)
    return camera.model_copy(update={"rois": rois})


def write(costs: dict[str, Cost]) -> None:
    """The page."""
    paced, every = costs.values()
    processors = os.cpu_count() or 1
    rows = [
        f"| {name} | {does} | {paced.stages_ms.get(name, 0.0):.2f} | {every.stages_ms.get(name, 0.0):.2f} |"
        for name, does in DOES.items()
    ]
    rows += [
        f"| **all** | | **{paced.frame_ms:.2f}** | **{every.frame_ms:.2f}** |",
        f"| bare decoding | | {paced.decoding_ms:.2f} | {every.decoding_ms:.2f} |",
        f"| **in units of it** | | **{paced.ratio:.2f}** | **{every.ratio:.2f}** |",
    ]
    table = "\n".join(rows)
    load, spare = os.getloadavg()[0], 100 * (1 - USABLE)
    PAGE.write_text(
        f"""<!-- Written by `python -m tests.benchmarks cost`. -->

# Where a frame's time goes

One region of {FPS} frames a second, {paced.width} x {paced.height} H.264, untrained, lump likelihood. CPU time in
milliseconds for each frame of the camera, whether it is decided on or not: by default {paced.decided_hz:.3g} a
second are, then every one. The work of the camera's and the monitor's process is done in one, with a bus between, as
`lumpwatch bench` does it on your own machine; medians of {ROUNDS} rounds that take turns with bare decoding. Load
average while it was measured: {load:.0f} on {processors} cores ({platform.machine()}). On a busy machine the times are
longer than on an idle one; ratios suffer less. What lies between `cut regions` and `filter` is divided by the clock on
the wall, which a busy machine disturbs.

| stage | what | by default | every frame |
|---|---|---|---|
{table}

By that, {processors} cores carry {paced.carried(processors)} such cameras by default and
{every.carried(processors)} decided on every frame, with {spare:.0f} % free. Clips of alarms, the console's pictures,
priors in shadow and the reception of RTSP are not in it.

Where a lump is followed, its place is also compared with what stood there before (`models/picture/standing.py`): some
3 ms a decision and lump on a busy machine, a quarter of the work on such frames. The clip has few of these, so by
default they are hardly in the table.
""",
        encoding="utf-8",
    )


def main() -> None:
    """Measure and write."""
    write(run())
    print(f"written: {PAGE}")
