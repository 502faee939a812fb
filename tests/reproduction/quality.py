"""Is the picture fit? BLIND without a fault, and how soon faults are found: docs/results/quality.md.

A reference is learned from one stretch of each simulated camera and judged on another: fault-free feeds of
several kinds, and faults laid over the standard one for some seconds.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from lumpwatch.models.picture.activity import Activity
from lumpwatch.models.picture.measures import PictureMeter
from lumpwatch.models.picture.reference import thumbnail
from lumpwatch.models.picture.registration import Registration
from lumpwatch.models.roi import Image, make_roi
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.decision import BlindReason, Decision
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.storage.reference_store import Reference
from lumpwatch.service.training.picture_reference import Recording, learn_reference
from tests.reproduction import faults
from tests.reproduction.faults import Fault
from tests.reproduction.matrix import STANDARD

DOCS = Path(__file__).parents[2] / "docs"
FPS, FEED_FPS = 5.0, 15.0
SEED = 5001
LEARN_S, CLEAN_S, CLEAN_FROM_S = 30.0, 30.0, 600.0
BEFORE_S, FAULT_S, AFTER_S, FAULT_FROM_S = 6.0, 14.0, 14.0, 1200.0

DAY: dict[str, dict[str, object]] = {
    "standard": {},
    "dust 0.7": {"dust": 0.7},
    "rain 0.7": {"rain": 0.7, "lens_drops": 10},
    "light drift 0.4": {"light_drift": 0.4},
    "belt stops": {"stop_every_s": 12.0, "stop_duration_s": 4.0},
}
STANDS: dict[str, dict[str, object]] = {
    "belt stands": {},
    "belt stands, quiet sensor, no dust": {"noise": 0.5, "dust": 0.0},
    "belt stands, coded by the camera": {"h264_crf": 32},
}
"""Judged by a reference of the same camera in which the belt never stopped."""
STANDING: dict[str, object] = {"stop_every_s": 2.0, "stop_duration_s": 600.0}
NIGHT: dict[str, dict[str, object]] = {"night 0.7": {"night": 0.7}}


def spec(style: str, **changes: object) -> FeedSpec:
    """The standard scene of a style with changes."""
    given = {**STANDARD.model_dump(exclude_unset=True), "style": style, "seed": SEED, **changes}
    return FeedSpec.model_validate(given)


def pictures(feed: FeedSpec, from_s: float, seconds: float) -> Iterator[Image]:
    """`FPS` pictures a second of a feed of `FEED_FPS`."""
    simulator = FeedSimulator(feed)
    simulator.skip(round(from_s * FEED_FPS))
    for _ in range(round(seconds * FPS)):
        yield simulator.render()[0]
        simulator.skip(round(FEED_FPS / FPS) - 1)


def frames(shown: Iterator[Image]) -> Iterator[Frame]:
    """Pictures as frames that come in time."""
    for k, picture in enumerate(shown):
        height, width = picture.shape
        yield Frame(k, k / FPS, k / FPS, k / FPS, width, height, "gray8", picture)


def camera(style: str) -> CameraConfig:
    """A camera on the belt of that style; few particles, for the filter is not what is measured."""
    polygon = FeedSimulator(spec(style)).polygon
    roi = {"id": "roi", "polygon": polygon, "detector": {"kind": "jdt", "particles": 50}}
    return CameraConfig.model_validate({"id": "camera", "source": {"url": "sim:feed"}, "rois": [roi]})


def learn(
    style: str, kinds: dict[str, dict[str, dict[str, object]]] | None = None, seconds: float = LEARN_S
) -> Reference:
    """From the first stretch of every kind in each light."""

    def recordings(some: dict[str, dict[str, object]]) -> list[Recording]:
        return [
            Recording(name, frames(pictures(spec(style, **changes), 30.0, seconds)))
            for name, changes in some.items()
        ]

    lights = {light: recordings(some) for light, some in (kinds or {"day": DAY, "night": NIGHT}).items()}
    return learn_reference(camera(style), lights, 1e-3, datetime(2026, 1, 1, tzinfo=UTC)).reference


@dataclass(frozen=True, slots=True)
class Clean:
    """A feed without a fault."""

    style: str
    kind: str
    lumps: bool
    frames: int
    blind: Counter[str]


def judge_clean(style: str, kind: str, changes: dict[str, object], reference: Reference) -> list[Clean]:
    """With lumps and without."""
    found = []
    for lumps in (True, False):
        feed = spec(style, **changes, **({} if lumps else {"lumps_per_minute": 0.0}))
        pipeline = CameraPipeline(camera(style), reference=reference)
        blind: Counter[str] = Counter()
        count = 0
        for frame in frames(pictures(feed, CLEAN_FROM_S, CLEAN_S)):
            (result,) = pipeline.process(frame, frame.received_s)
            count += 1
            if result.reason is not None:
                blind[result.reason.value] += 1
        found.append(Clean(style, kind, lumps, count, blind))
    return found


@dataclass(frozen=True, slots=True)
class Case:
    """A fault, the checks that may find it, and its stated time."""

    name: str
    fault: Callable[[], Fault]
    reasons: tuple[BlindReason, ...]
    later_s: float = 0.0
    """How much later than others of its kind it may be found."""


R = BlindReason
KEY_FRAMES_S = 1.0  # of the coder that codes a frozen picture again
CASES = (
    Case("blur, sigma 2 px", lambda: faults.blurred(2.0), (R.BLURRED,)),
    Case("blur, sigma 4 px", lambda: faults.blurred(4.0), (R.BLURRED, R.HIDDEN)),
    Case("dust, veil of 85 %", lambda: faults.dusty(0.85), (R.DUSTY, R.HIDDEN)),
    Case("dark, 5 % of the light", lambda: faults.dark(0.05), (R.DARK,)),
    Case("dark, 15 % of the light", lambda: faults.dark(0.15), (R.DARK,)),
    Case("glare", faults.glare, (R.GLARE,)),
    Case("hidden by a plate", faults.hidden, (R.HIDDEN, R.DUSTY)),
    Case("dirt on the lens", faults.dirty, (R.HIDDEN, R.DUSTY)),
    Case("frozen", lambda: faults.frozen(FPS), (R.FROZEN,)),
    Case("frozen, clock runs", lambda: faults.frozen(FPS, stamped=True), (R.FROZEN,)),
    Case("frozen, coded again", lambda: faults.frozen(FPS, crf=26), (R.FROZEN,), KEY_FRAMES_S),
    Case("frozen, coded again coarsely", lambda: faults.frozen(FPS, crf=34), (R.FROZEN,), KEY_FRAMES_S),
    Case(
        "frozen, clock runs, coded again",
        lambda: faults.frozen(FPS, stamped=True, crf=26),
        (R.FROZEN,),
        KEY_FRAMES_S,
    ),
    Case("camera moved 24, 12 px", lambda: faults.knocked(24, 12), (R.MOVED,)),
    Case("camera moved 6, -4 px", lambda: faults.knocked(6, -4), ()),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a fault."""

    style: str
    case: str
    found_s: float | None
    """Until the ROI was BLIND; for a small shift until it was followed."""
    stated_s: float
    reasons: tuple[str, ...]
    recovered_s: float | None
    """After the end of the fault."""
    followed_px: tuple[int, int]


def inject(style: str, case: Case, fit: list[Image], reference: Reference) -> Outcome:
    """The feed without, with, and again without the fault."""
    config = camera(style)
    pipeline = CameraPipeline(config, reference=reference)
    fault = case.fault()
    begin, end = round(BEFORE_S * FPS), round((BEFORE_S + FAULT_S) * FPS)

    def faulty() -> Iterator[Image]:
        for k, picture in enumerate(fit):
            yield fault(picture, k) if begin <= k < end else picture

    found: float | None = None
    last_bad, reasons, followed = end, [], (0, 0)
    for frame in frames(faulty()):
        (result,) = pipeline.process(frame, frame.received_s)
        k, shift = frame.seq, pipeline.quality.shift
        followed = shift.followed_px if begin <= k < end else followed
        hit = shift.followed_px != (0, 0) if not case.reasons else result.reason in case.reasons
        if begin <= k < end:
            if hit and found is None:
                found = (k - begin) / FPS
            if result.reason is not None and result.reason.value not in reasons:
                reasons.append(result.reason.value)
        unfit = result.decision is Decision.BLIND or shift.followed_px != (0, 0)
        last_bad = k if k >= end and unfit else last_bad
    recovered = None if last_bad == end + round(AFTER_S * FPS) - 1 else (last_bad + 1 - end) / FPS
    quality = config.quality
    checks = [getattr(quality, reason.value) for reason in case.reasons] or [quality.moved]
    stated = max(quality.found_within_s(check) for check in checks[:1]) + case.later_s
    return Outcome(style, case.name, found, stated, tuple(reasons), recovered, followed)


def costs() -> dict[str, float]:
    """Milliseconds of the parts, medians, and of one step of the filter as it is by default."""
    shown = list(pictures(spec("a"), 60.0, 6.0))
    polygon = FeedSimulator(spec("a")).polygon
    roi = make_roi(polygon, 640, 480, 320)
    grays, small = [roi.cut(one) for one in shown], thumbnail(shown[0])
    meter, activity = PictureMeter(roi.mask), Activity(2.0)
    registration = Registration(small, np.zeros_like(small))
    whole = CameraConfig.model_validate(
        {"id": "c", "source": {"url": "sim:feed"}, "rois": [{"id": "r", "polygon": polygon}]}
    )
    steps: list[float] = []

    class Watch:
        def dropped(self, reason: str) -> None: ...
        def paced(self, roi: str) -> None:
            """Not looked at."""

        def prior_refused(self, roi: str, reason: str) -> None: ...
        def stage(self, stage: str, roi: str, seconds: float) -> None:
            if stage == "filter":
                steps.append(1e3 * seconds)

    def registered(picture: Image) -> object:
        return registration.shift(thumbnail(picture))

    pipeline = CameraPipeline(whole, observer=Watch())
    for frame in frames(iter(shown)):
        pipeline.process(frame, frame.received_s)
    return {
        "look": _timed([partial(meter.measure, g) for g in grays]),
        "activity": _timed([partial(activity.add, k / FPS, g) for k, g in enumerate(grays)]),
        "registration": _timed([partial(registered, s) for s in shown]),
        "filter": float(np.median(steps)),
    }


def _timed(jobs: list[Callable[[], object]]) -> float:
    times = []
    for job in jobs:
        began = time.perf_counter()
        job()
        times.append(1e3 * (time.perf_counter() - began))
    return float(np.median(times))


def measure(style: str) -> tuple[list[Clean], list[Outcome]]:
    """Everything on one style."""
    reference = learn(style)
    clean = [
        one
        for kind, changes in {**DAY, **NIGHT}.items()
        for one in judge_clean(style, kind, changes, reference)
    ]
    for kind, changes in STANDS.items():
        running = learn(style, {"day": {kind: changes}}, 2 * LEARN_S)
        clean += judge_clean(style, kind, {**changes, **STANDING}, running)
    fit = list(pictures(spec(style), FAULT_FROM_S, BEFORE_S + FAULT_S + AFTER_S))
    return clean, [inject(style, case, fit, reference) for case in CASES]


def main() -> None:
    """Measure and write the page and its plot."""
    from tests.reproduction.quality_page import draw, page

    with ProcessPoolExecutor(2) as pool:
        done = list(pool.map(measure, ("a", "b")))
    clean = [one for some, _ in done for one in some]
    outcomes = [one for _, some in done for one in some]
    draw(outcomes, DOCS / "images" / "quality.png")
    (DOCS / "results" / "quality.md").write_text(page(clean, outcomes, costs()), encoding="utf-8")


if __name__ == "__main__":
    main()
