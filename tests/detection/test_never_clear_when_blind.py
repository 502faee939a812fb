"""Whatever comes to the pipeline, in whatever order: a picture that is too old or unfit is not CLEAR for long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import DetectorConfig, JdtConfig
from lumpwatch.service.core.decision import BlindReason, Decision, RoiResult
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from tests.belt_scene import (
    FPS,
    REFERENCE,
    Fault,
    belt,
    blurred,
    dark,
    dusty,
    every_frame,
    frames,
    frozen,
    plate,
    turned,
    white,
)
from tests.belt_scene import camera as belt_camera
from tests.service_helpers import camera, frame, prior

CONFIG = camera(particles=50)
KNOWN = {"apron": prior()}
EVENTS = st.lists(
    st.tuples(
        st.floats(0.0, 1.5),  # seconds until it happens
        st.sampled_from(("frame", "same again", "nothing")),
        st.floats(0.0, 2.0),  # age of the picture when it comes
        st.booleans(),  # whether the lump is in it
    ),
    max_size=12,
)


@pytest.mark.slow
@settings(max_examples=60)
@given(EVENTS)
def test_clear_needs_a_picture_that_is_young_enough(events: list[tuple[float, str, float, bool]]) -> None:
    target = CameraPipeline(CONFIG, KNOWN)
    now, last = 100.0, None
    newest: float | None = None
    received = 0.0
    for number, (wait_s, kind, age_s, bright) in enumerate(events):
        now += wait_s
        if kind == "frame":
            last = frame(number, time_s=now - age_s, received_s=now, bright=bright)
        results = target.process(last, now) if last is not None and kind != "nothing" else ()
        if last is not None and results:
            newest, received = last.capture_s, now
        for result in results or target.poll(now):
            young = newest is not None and max(now - newest, now - received) <= CONFIG.blind_after_s
            assert (result.decision is not Decision.BLIND) == young


class Ailing(JdtDetector):
    """A detector that is left with one particle while it is "starved", and whose step raises while "failing"."""

    def __init__(self, config: JdtConfig, roi: Roi, learned: Learned | None, ails: Callable[[], str]) -> None:
        super().__init__(config, roi, learned)
        self.ails = ails

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        if self.ails() == "failing":
            raise FloatingPointError("weights")
        found = super().step(gray, colour, dt)
        return replace(found, effective_particles=1.0) if self.ails() == "starved" else found


FAULTS: dict[str, Fault] = {
    "blurred": blurred,
    "dusty": dusty,
    "dark": dark,
    "white": white,
    "plate": plate,
    "frozen": frozen,
    "turned": turned,
}
KINDS = (*FAULTS, "silent", "late", "skipping", "starved", "failing")
# Of a camera of 50 frames a second 5 are half of what is due, but a tenth of all.
BUSY = every_frame(belt_camera(overload={"longest_age_s": 0.5}))
QUALITY = BUSY.quality
CHECKS = (
    QUALITY.frozen,
    QUALITY.dark,
    QUALITY.glare,
    QUALITY.blurred,
    QUALITY.dusty,
    QUALITY.hidden,
    QUALITY.moved,
    QUALITY.filter,
    QUALITY.overload,
)
LIMIT_S = max(map(QUALITY.found_within_s, CHECKS))
"""However unfit the picture is, after so long nothing is CLEAR."""
RECOVERED_S = LIMIT_S + max(check.exit_s for check in CHECKS)


class Feed:
    """The belt's camera and its pipeline on one clock, through whatever happens."""

    def __init__(self) -> None:
        self.pipeline = CameraPipeline(BUSY, {"apron": prior()}, reference=REFERENCE, make=self._detector)
        self.now, self.seq, self.k = 100.0, 0, 0
        self.kind = "fit"

    def _detector(self, config: DetectorConfig, roi: Roi, learned: Learned | None) -> Ailing:
        assert isinstance(config, JdtConfig)
        return Ailing(config, roi, learned, lambda: self.kind)

    def second(self, kind: str) -> list[RoiResult]:
        """What is said in a second of this."""
        return [one for _ in range(round(FPS)) for one in self._picture(kind)]

    def _picture(self, kind: str) -> tuple[RoiResult, ...]:
        self.now += 1.0 / FPS
        self.k += 1
        self.seq += 10 if kind == "skipping" else 1
        if kind == "silent":
            return self.pipeline.poll(self.now)
        self.kind = kind
        shown = belt(200 + self.k % 600)
        if kind in FAULTS:
            shown = FAULTS[kind](shown, self.k)
        then = self.now - (0.8 if kind == "late" else 0.0)
        (one,) = frames(iter([shown]), self.seq)
        taken = self.pipeline.process(replace(one, capture_s=then, received_s=then), self.now)
        return taken or self.pipeline.poll(self.now)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(KINDS), st.integers(6, 12)), min_size=1, max_size=4))
def test_nothing_unfit_is_clear_for_longer_than_the_limit(faults: list[tuple[str, int]]) -> None:
    feed = Feed()
    for _ in range(8):
        said = feed.second("fit")
    assert {one.decision for one in said} == {Decision.CLEAR}
    # Each lasts a while: medians over seconds do not see faults that take turns faster.
    blind_s = feed.now
    for kind, seconds in faults:
        for _ in range(seconds):
            told = feed.second(kind)
            blind_s = feed.now if told[-1].decision is Decision.BLIND else blind_s
            assert feed.now - blind_s <= LIMIT_S + 1.0, kind
    for _ in range(round(RECOVERED_S) + 1):
        said = feed.second("fit")
    assert {(one.decision, one.reason) for one in said} == {(Decision.CLEAR, None)}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_is_blind_in_its_time(kind: str) -> None:
    feed = Feed()
    for _ in range(8):
        feed.second("fit")
    said = [one for _ in range(round(LIMIT_S) + 1) for one in feed.second(kind)]
    expected = {
        "white": BlindReason.GLARE,
        "plate": BlindReason.HIDDEN,
        "turned": BlindReason.MOVED,
        "silent": BlindReason.NO_STREAM,
        "late": BlindReason.OVERLOAD,
        "skipping": BlindReason.OVERLOAD,
        "starved": BlindReason.FILTER,
        "failing": BlindReason.FILTER,
    }
    assert (expected.get(kind) or BlindReason(kind)) in {one.reason for one in said}
    assert {one.decision for one in said[-round(FPS) :]} == {Decision.BLIND}
    assert not any(one.fit for one in said[-round(FPS) :])
    detector = feed.pipeline.detector("apron")
    assert detector is not None
    if kind not in ("silent", "failing"):  # where no step is made
        assert not detector.learns
    for _ in range(round(RECOVERED_S) + 1):
        feed.second("fit")
    detector = feed.pipeline.detector("apron")
    assert detector is not None
    assert detector.learns
