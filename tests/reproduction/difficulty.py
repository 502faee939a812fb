"""How the lump filter stands up to the matrix of difficulty: lumps announced in time, and false alarms.

The prior is learned from one minute of each style's standard scene, as a plant would; no other scene is
trained on. Every cell is played on feeds with lumps and on feeds without, of seeds that nothing was
learned from.
"""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from service.backtest.intervals import poisson_interval
from service.config import CameraConfig, parse
from service.feed.simulator import FeedSimulator, Truth
from service.feed.spec import FeedSpec
from service.frames import Frame
from service.labels import Box
from service.messages import Decision
from service.pipeline import CameraPipeline, RoiResult
from service.store.prior import Prior, decode, encode
from service.training import train
from tests.reproduction import matrix
from tests.reproduction.lumps import lies_on

DOCS = Path(__file__).parents[2] / "docs"
WORKERS = 2
SECONDS = 60.0
FEEDS, EMPTY_FEEDS = 2, 1
LEAST_WARNING_S = 1.0
TOLERANCE_S = 0.5
"""A raise within this of a labelled lump is no false alarm."""
_ROI = "apron"


@dataclass(frozen=True, slots=True)
class Played:
    """One feed, watched."""

    fell: int
    """Lumps whose fall the feed shows."""
    warnings_s: tuple[float, ...]
    """Warning time of each that was announced before its fall."""
    false_alarms: int
    seconds: float


def camera_of(style: str, switching: str = "adaptive") -> CameraConfig:
    """A camera over a feed of the style."""
    polygon = [[float(v) for v in point] for point in FeedSimulator(FeedSpec(style=style)).polygon]
    return parse(
        f"""\
site: matrix
cameras:
  - id: feed
    source: {{url: "sim:feed"}}
    rois:
      - id: {_ROI}
        polygon: {polygon}
        detector: {{kind: jdt, switching: {switching}}}
        alarm: {{raise_above: 0.9, clear_below: 0.5, on_delay_s: 0.2, off_delay_s: 1.0, latch: false}}
"""
    ).cameras[0]


def learn(style: str) -> Prior:
    """A prior from the first training feed of the style's standard scene."""
    scene = matrix.scene("standard" if style == "a" else "b-standard")
    camera = camera_of(style)
    spec = next(scene.train())
    frames, boxes = [], []
    for frame, truths in _watch(spec):
        frames.append(frame)
        boxes += [Box(frame.seq + 1, t.id, t.x, t.y, t.w, t.h, t.model) for t in truths]
    boxes.sort(key=lambda box: (box.track, box.frame))
    roi = camera.rois[0]
    trained = train(roi, frames, tuple(boxes), Path("feed.txt"), "feed")
    return trained.as_prior(camera.id, roi, "feed", datetime(2026, 1, 1, tzinfo=UTC))


def _watch(spec: FeedSpec, seconds: float = SECONDS):  # type: ignore[no-untyped-def]
    feed = FeedSimulator(spec)
    for i in range(round(seconds * spec.fps)):
        picture, truths = feed.render()
        t = i / spec.fps
        yield Frame(i, t, t, t, spec.width, spec.height, "gray8", picture), truths


def play(spec: FeedSpec, prior: bytes, switching: str = "adaptive") -> Played:
    """Watch one feed."""
    cv2.setNumThreads(1)
    camera = camera_of(spec.style, switching)
    pipeline = CameraPipeline(camera, {_ROI: decode(prior, "prior")})
    first: dict[int, float] = {}
    falls: dict[int, float] = {}
    raised, present = [], []
    for frame, truths in _watch(spec):
        time_s = frame.capture_s
        if truths:
            present.append(time_s)
        for truth in truths:
            if truth.model == "fall":
                falls.setdefault(truth.id, time_s)
        for result in pipeline.process(frame, time_s):
            if result.transition is not None and result.transition.change == "raised":
                raised.append(time_s)
            for truth in truths:
                if truth.id not in first and truth.id not in falls and _announces(result, truth):
                    first[truth.id] = time_s
    there = np.array(present)
    false = sum(1 for t in raised if not len(there) or np.abs(there - t).min() > TOLERANCE_S)
    warnings = tuple(falls[lump] - first[lump] for lump in falls if lump in first)
    return Played(len(falls), warnings, false, SECONDS)


def _announces(result: RoiResult, truth: Truth) -> bool:
    """Whether the ROI says LUMP with an estimate on this lump."""
    if result.decision is not Decision.LUMP or result.detection is None:
        return False
    return any(lies_on(one, truth) for one in result.detection.objects)


def run(pool: Executor, feeds: int = FEEDS, empty: int = EMPTY_FEEDS) -> dict[str, tuple[Played, Played]]:
    """Each scene: all its feeds with lumps, and all without, summed."""
    priors = dict(zip("ab", (encode(prior) for prior in pool.map(learn, "ab")), strict=True))
    scenes = list(matrix.scenes())
    specs = [list(islice(scene.test(), feeds)) for scene in scenes]
    specs_empty = [list(islice(scene.test_empty(), empty)) for scene in scenes]
    flat = [spec for some in (*specs, *specs_empty) for spec in some]
    done = iter(list(pool.map(play, flat, [priors[spec.style] for spec in flat])))
    lumps = [_sum([next(done) for _ in some]) for some in specs]
    none = [_sum([next(done) for _ in some]) for some in specs_empty]
    return {scene.name: (a, b) for scene, a, b in zip(scenes, lumps, none, strict=True)}


def _sum(some: list[Played]) -> Played:
    return Played(
        sum(one.fell for one in some),
        tuple(w for one in some for w in one.warnings_s),
        sum(one.false_alarms for one in some),
        sum(one.seconds for one in some),
    )


def in_time(played: Played) -> int:
    """Lumps announced early enough."""
    return sum(w >= LEAST_WARNING_S for w in played.warnings_s)


def main() -> None:
    """Play the matrix and write the page."""
    began = time.monotonic()
    with ProcessPoolExecutor(WORKERS, multiprocessing.get_context("spawn")) as pool:
        found = run(pool)
    print(f"  matrix: {time.monotonic() - began:.0f} s")
    draw(found, DOCS / "images" / "difficulty.png")
    (DOCS / "results" / "difficulty.md").write_text(write(found), encoding="utf-8")


def write(found: dict[str, tuple[Played, Played]]) -> str:
    """The page."""
    rows = []
    for name, (lumps, empty) in found.items():
        warnings = sorted(lumps.warnings_s)
        times = f"{np.median(warnings):.1f} | {np.percentile(warnings, 10):.1f}" if warnings else "- | -"
        rows.append(
            f"| {name} | {lumps.fell} | {in_time(lumps)} | {times} | {lumps.false_alarms} | {empty.false_alarms} |"
        )
    total = sum(empty.seconds for _, empty in found.values()) / 3600.0
    alarms = sum(empty.false_alarms for _, empty in found.values())
    low, high = poisson_interval(alarms, total)
    fell = sum(lumps.fell for lumps, _ in found.values())
    early = sum(in_time(lumps) for lumps, _ in found.values())
    table = "\n".join(rows)
    return f"""<!-- Written by `make reproduce`. -->

# The matrix of difficulty

The lump filter (`kind: jdt`, stated defaults otherwise) on every scene of the [simulated feed](../simulator.md).
Its prior is learned from one minute of the standard scene of each style, and from no other scene. A lump
counts when the ROI says LUMP, with the estimate on that lump, {LEAST_WARNING_S:g} s or more before its fall begins.
False alarms are raises while no lump is in the picture: in the {SECONDS * FEEDS / 60:g} minutes with lumps, and in
{SECONDS * EMPTY_FEEDS / 60:g} without any.

Over all scenes {early} of {fell} lumps were announced in time, with {alarms} false alarms in {total:.1f} lump-free
hours: {alarms / total:.1f} an hour (95 % interval {low:.1f} to {high:.1f}).

![Share of lumps announced in time, and false alarms](../images/difficulty.png)

| scene | lumps | announced in time | median warning (s) | worst tenth (s) | false alarms among lumps | without lumps |
|---|---|---|---|---|---|---|
{table}
"""


def draw(found: dict[str, tuple[Played, Played]], path: Path) -> None:
    """A bar for each scene: lumps announced in time; dots: false alarms."""
    names = list(found)
    share = [in_time(lumps) / max(lumps.fell, 1) for lumps, _ in found.values()]
    false = [lumps.false_alarms + empty.false_alarms for lumps, empty in found.values()]
    figure = Figure(figsize=(9.0, 0.19 * len(names) + 1.2), layout="constrained")
    axes, beside = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    y = np.arange(len(names))
    axes.barh(y, share, color=["tab:orange" if name.startswith("b-") else "tab:blue" for name in names])
    axes.set_yticks(y, names, fontsize=7)
    axes.set(xlim=(0, 1.02), xlabel="lumps announced in time (share)", ylim=(len(names) - 0.3, -0.7))
    axes.grid(axis="x", alpha=0.3)
    beside.barh(y, false, color="tab:red")
    beside.set(xlabel="false alarms")
    beside.grid(axis="x", alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
