"""A shadow beside a pipeline: what it counts, when it is left out, and that it can do no harm."""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry

from lumpwatch.models.learning import HistogramFit
from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.config.detector import DetectorConfig
from lumpwatch.service.core.decision import RoiResult
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.detectors.base import Detector, FilterState
from lumpwatch.service.detection.region_channel import MakeDetector
from lumpwatch.service.detection.shadow.shadows import Shadows
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.offline.replay import run_replay
from lumpwatch.service.offline.shadow_replay import ReplayShadow
from lumpwatch.service.protocol.shadow import Counts, ShadowState, summary
from lumpwatch.service.storage.prior_file import Prior
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.shadow_store import StateKeeper, read_state, state_file
from lumpwatch.service.telemetry import MonitorMetrics
from lumpwatch.service.telemetry.shadow import ShadowMetrics
from tests.service_helpers import POLYGON, camera, frame, learned, prior, site, site_tree

NOW = datetime(2024, 5, 17, 12, 30, tzinfo=UTC)


class Scripted:
    """A detector that says what it is told to, one call after the other; an exception is raised."""

    def __init__(self, roi: Roi, script: list[float | Exception], spoil: bool = False) -> None:
        self.roi = roi
        self.learns = True
        self.intervals: list[float] = []
        self._script = script
        self._spoil = spoil

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        self.intervals.append(dt)
        if self._spoil and gray.flags.writeable:
            gray[:] = 255
        said = self._script[min(len(self.intervals), len(self._script)) - 1]
        if isinstance(said, Exception):
            raise said
        return Detection(said, ())

    def use(self, learned: Learned | None) -> None:
        raise AssertionError

    def clouds(self) -> tuple[Belief, ...]:
        return ()

    def state(self) -> FilterState | None:
        return None

    def restore(self, state: FilterState) -> None:
        raise AssertionError


def scripted(*said: float | Exception, made: list[Scripted] | None = None) -> MakeDetector:
    def make(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
        detector = Scripted(roi, list(said), spoil=True)
        if made is not None:
            made.append(detector)
        return detector

    return make


class Clock:
    """Every look at it finds it `step` seconds later."""

    def __init__(self, step: float) -> None:
        self._now, self._step = 0.0, step

    def __call__(self) -> float:
        self._now += self._step
        return self._now


def blinded() -> Prior:
    """A prior by which nothing is ever an object."""
    reference = np.full(16, 0.01 / 16)
    reference[15] += 0.99
    return prior(learned(likelihood=HistogramFit(reference, -20.0, 0.0, "luma")), version=2)


def bare(result: RoiResult) -> RoiResult:
    """Without the pixels, which cannot be compared."""
    return replace(result, frame=None)


def scene(*lengths: int) -> list[Frame]:
    """So many dark frames, then so many bright ones, and so on, ten a second."""
    shown = [k % 2 == 1 for k, length in enumerate(lengths) for _ in range(length)]
    return [frame(seq, bright=bright) for seq, bright in enumerate(shown)]


def run(
    frames: list[Frame],
    shadows: Shadows | None,
    config: CameraConfig | None = None,
    spent_s: float = 0.0,
    each: Callable[[], None] = lambda: None,
) -> list[RoiResult]:
    """A pipeline over the frames, a shadow behind it as the monitor has it."""
    pipeline = CameraPipeline(config or camera(), {"apron": prior(version=1)})
    results = []
    for one in frames:
        found = pipeline.process(one, one.received_s)
        results += [bare(result) for result in found]
        if shadows is not None:
            shadows.follow(found, spent_s)
        each()
    return results


def shadows_of(
    make: MakeDetector | None = None,
    clock: Callable[[], float] | None = None,
    used: Prior | None = None,
    observer: ShadowMetrics | None = None,
) -> Shadows:
    extra = {} if make is None else {"make": make}
    target = Shadows(camera(), lambda: NOW, clock, observer, **extra)
    target.use("apron", used or prior(version=2), current=1)
    return target


def state(target: Shadows) -> ShadowState:
    found = target.state("apron")
    assert found is not None
    return found


# What is counted


def test_the_same_prior_in_shadow_differs_in_nothing() -> None:
    target = shadows_of()
    results = run(scene(10, 20, 20, 15), target)
    found = state(target)
    raised = [r for r in results if r.transition and r.transition.change.value == "raised"]
    assert len(raised) == 2
    assert (found.both, found.only_current, found.only_shadow, found.lead_s) == (2, 0, 0, 0.0)
    assert found.agree_s == pytest.approx(6.4)
    assert (found.only_current_s, found.only_shadow_s) == (0.0, 0.0)
    assert (found.frames, found.skipped, found.failed) == (65, 0, None)
    assert (found.version, found.current, found.since) == (2, 1, NOW)
    assert found.lump


def test_a_shadow_that_sees_nothing_misses_the_alarm(caplog: pytest.LogCaptureFixture) -> None:
    target = shadows_of(used=blinded())
    with caplog.at_level(logging.INFO):
        results = run(scene(10, 20, 80), target)
    found = state(target)
    alarm_s = sum(r.alarm.active for r in results) * 0.1
    assert alarm_s > 1.0
    assert (found.both, found.only_current, found.only_shadow) == (0, 1, 0)
    assert found.only_current_s == pytest.approx(alarm_s)
    assert "cam/apron: shadow version 2: raises no alarm where version 1 does" in caplog.text
    assert not found.lump


def test_a_shadow_that_always_sees_a_lump_has_one_alarm_more() -> None:
    target = shadows_of(scripted(1.0))
    results = run(scene(100), target)
    assert not any(r.changes for r in results)
    found = state(target)
    assert (found.both, found.only_current, found.only_shadow) == (0, 0, 1)
    # 9.9 s between 100 frames; the on-delay of 0.2 s passes first.
    assert found.agree_s == pytest.approx(0.2)
    assert found.only_shadow_s == pytest.approx(9.7)


def test_holds_and_acknowledgements_make_no_difference() -> None:
    tree = site_tree()
    config = site(tree).cameras[0]
    pipeline = CameraPipeline(config, {"apron": prior(version=1)})
    target = shadows_of()
    for one in scene(10, 20, 20):
        found = pipeline.process(one, one.received_s)
        target.follow(found, 0.0)
        if found[0].alarm.waits:
            pipeline.acknowledge("apron", "Ada", one.received_s)
    assert (state(target).both, state(target).only_current_s, state(target).only_shadow_s) == (1, 0.0, 0.0)


def test_another_prior_in_use_is_compared_anew() -> None:
    target = shadows_of(used=prior(version=3))
    pipeline = CameraPipeline(camera(), {"apron": prior(version=1)})
    for one in scene(10):
        target.follow(pipeline.process(one, one.received_s), 0.0)
    assert (state(target).current, state(target).frames) == (1, 10)
    pipeline.use_prior("apron", prior(version=2))
    target.follow(pipeline.process(frame(10), 1.0), 0.0)
    assert (state(target).current, state(target).frames) == (2, 1)
    pipeline.use_prior("apron", None)
    target.follow(pipeline.process(frame(11), 1.1), 0.0)
    # The histogram likelihood needs a prior: the defaults were refused, version 2 stayed.
    assert state(target).current == 2


def test_what_was_kept_goes_on_for_the_same_two_only() -> None:
    kept = state(shadows_of()).model_copy(update={"agree_s": 50.0, "both": 3, "since": NOW.replace(day=1)})
    for version, current, begins in ((2, 1, False), (2, 4, True), (3, 1, True)):
        target = Shadows(camera(), lambda: NOW, None)
        target.use("apron", prior(version=version), current, kept)
        found = state(target)
        assert (found.both, found.agree_s) == ((0, 0.0) if begins else (3, 50.0))
        assert found.since == (NOW if begins else kept.since)


def test_a_region_without_a_shadow_is_left_alone() -> None:
    target = shadows_of()
    target.use("apron", None)
    run(scene(3), target)
    assert target.state("apron") is None


# When it is left out


def test_time_that_is_short_thins_the_shadow() -> None:
    """Of the 100 ms between frames 80 may be used; 60 are, so 20 are left for a shadow that takes 40."""
    made: list[Scripted] = []
    target = shadows_of(scripted(0.0, made=made), Clock(0.04))
    run(scene(101), target, spent_s=0.06)
    found = state(target)
    assert found.frames + found.skipped == 101
    assert 47 <= found.frames <= 51
    (detector,) = made
    assert len(detector.intervals) == found.frames
    assert detector.intervals[5:10] == pytest.approx([0.2] * 5)
    assert found.agree_s == pytest.approx(9.9)  # between its looks its decision stands


def test_a_busy_machine_runs_no_shadow_and_compares_nothing() -> None:
    target = shadows_of(scripted(1.0), Clock(0.001))
    run(scene(50), target, spent_s=0.09)
    found = state(target)
    assert (found.frames, found.skipped, found.existence) == (0, 50, None)
    assert found.counts.judged_s == 0.0


def test_frames_that_were_skipped_leave_no_time_over() -> None:
    """A monitor that needs 90 ms of every 100 skips frames: the longer interval is not free time."""
    target = shadows_of(scripted(1.0), Clock(0.001))
    run([one for one in scene(60) if one.seq % 3 == 0], target, spent_s=0.09)
    assert state(target).frames == 0


def test_time_that_is_short_is_shared() -> None:
    tree = site_tree()
    first = tree["cameras"][0]["rois"][0]
    tree["cameras"][0]["rois"].append({**first, "id": "chute"})
    config = site(tree).cameras[0]
    target = Shadows(config, lambda: NOW, Clock(0.08), make=scripted(0.0))
    pipeline = CameraPipeline(config, {"apron": prior(), "chute": prior(roi="chute")})
    for roi in ("apron", "chute"):
        target.use(roi, prior(roi=roi, version=2))
    for one in scene(81):
        target.follow(pipeline.process(one, one.received_s), 0.04)
    looked = [found.frames for roi in ("apron", "chute") if (found := target.state(roi)) is not None]
    assert sum(looked) == pytest.approx(40, abs=3)
    assert min(looked) > 10


# That it can do no harm

said = st.lists(
    st.one_of(
        st.floats(allow_nan=True, allow_infinity=True),
        st.sampled_from([0.0, 1.0, RuntimeError("broken"), MemoryError(), ZeroDivisionError("x")]),
    ),
    min_size=1,
    max_size=12,
)
FRAMES = scene(4, 8, 6)
ALONE = run(FRAMES, None)


@given(said, st.sampled_from([None, 0.0, 0.03, 10.0]), st.booleans())
@settings(max_examples=40, deadline=None)
def test_whatever_the_shadow_does_the_decisions_are_the_same(
    script: list[float | Exception], cost_s: float | None, fails_to_begin: bool
) -> None:
    def refuse(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
        raise RuntimeError("cannot begin")

    clock = None if cost_s is None else Clock(cost_s)
    target = shadows_of(refuse if fails_to_begin else scripted(*script), clock)
    assert run(FRAMES, target) == ALONE
    assert any(result.changes for result in ALONE)


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ([0.1, 0.1, RuntimeError("broken")], "RuntimeError: broken"),
        ([0.1, 0.1, float("nan")], "existence nan is not a probability"),
        ([0.1, 0.1, float("inf")], "existence inf is not a probability"),
    ],
)
def test_a_shadow_that_fails_ends_and_is_counted(
    script: list[float | Exception], told: str, caplog: pytest.LogCaptureFixture
) -> None:
    registry = CollectorRegistry()
    observer = MonitorMetrics(registry, "cam", ("apron",)).shadows
    target = shadows_of(scripted(*script), observer=observer)
    run(scene(10), target)
    found = state(target)
    assert found.failed is not None
    assert told in found.failed
    assert found.frames == 2
    assert "shadow version 2 ended" in caplog.text
    assert samples(registry)["lumpwatch_shadow_failures_total", "failed"] == 1
    assert samples(registry)["lumpwatch_shadow_prior_version", ""] == 0
    target.use("apron", prior(version=2))
    assert state(target).failed is None


def test_a_shadow_for_another_polygon_ends(caplog: pytest.LogCaptureFixture) -> None:
    registry = CollectorRegistry()
    other = prior(version=2, polygon=tuple((x / 2, y) for x, y in POLYGON))
    target = shadows_of(used=other, observer=MonitorMetrics(registry, "cam", ("apron",)).shadows)
    run(scene(3), target)
    assert "was trained for another polygon" in (state(target).failed or "")
    assert samples(registry)["lumpwatch_shadow_failures_total", "unfit"] == 1
    assert "Traceback" not in caplog.text


# What is told and kept


def samples(registry: CollectorRegistry) -> Counter[tuple[str, str]]:
    """Values by name and what they are of."""
    found: Counter[tuple[str, str]] = Counter()
    for family in registry.collect():
        for one in family.samples:
            of = next((one.labels[name] for name in ("reason", "side", "outcome") if name in one.labels), "")
            found[one.name, of] += one.value  # type: ignore[assignment]
    return found


def test_metrics_are_the_counts() -> None:
    registry = CollectorRegistry()
    target = shadows_of(used=blinded(), observer=MonitorMetrics(registry, "cam", ("apron",)).shadows)
    run(scene(10, 20, 80), target)
    found, told = state(target), samples(registry)
    assert told["lumpwatch_shadow_raised_alarms_total", "only_current"] == 1
    assert told["lumpwatch_shadow_raised_alarms_total", "both"] == 0
    assert told["lumpwatch_shadow_agreement_seconds_total", "agree"] == pytest.approx(found.agree_s)
    assert told["lumpwatch_shadow_agreement_seconds_total", "only_current"] == pytest.approx(
        found.only_current_s
    )
    assert told["lumpwatch_shadow_judged_frames_total", "looked"] == 110
    assert told["lumpwatch_shadow_prior_version", ""] == 2
    assert told["lumpwatch_shadow_existence_ratio", ""] == found.existence


def written(store: PriorStore, found: ShadowState) -> None:
    store.folder("cam", "apron").mkdir(parents=True, exist_ok=True)
    keeper = StateKeeper(store)
    keeper.keep(found.model_copy(update={"both": 0}))
    keeper.keep(found)
    keeper.close()


def test_a_state_comes_back_from_the_disk(tmp_path: Path) -> None:
    store = PriorStore(tmp_path)
    assert read_state(store, "cam", "apron") is None
    target = shadows_of()
    run(scene(5, 10), target)
    written(store, state(target))
    assert read_state(store, "cam", "apron") == state(target)
    assert read_state(store, "cam", "apron").counts == state(target).counts  # type: ignore[union-attr]


@pytest.mark.parametrize("content", [b"", b"{", b'{"camera": "cam"}', b"\xff\xfe"])
def test_a_state_that_cannot_be_read_is_passed_over(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    store = PriorStore(tmp_path)
    path = state_file(store, "cam", "apron")
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    assert read_state(store, "cam", "apron") is None
    assert f"{path}: cannot be used" in caplog.text


def test_a_disk_that_refuses_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    keeper = StateKeeper(PriorStore(tmp_path / "none"))
    keeper.keep(state(shadows_of()))
    keeper.close()
    assert caplog.text.count("cannot be written") == 1


def test_the_summary_for_people() -> None:
    found = state(shadows_of()).model_copy(
        update={
            "agree_s": 3564.0,
            "only_current_s": 6.0,
            "only_shadow_s": 30.0,
            "both": 4,
            "only_current": 1,
            "only_shadow": 2,
            "lead_s": 2.0,
            "frames": 30,
            "skipped": 10,
            "failed": "RuntimeError: x",
        }
    )
    assert found.counts == Counts(3564.0, 6.0, 30.0, 4, 1, 2, 2.0, 30, 10)
    text = "\n".join(summary(found))
    for told in (
        "version 2 in shadow of version 1",
        "1.00 h, the same decision in 99.00 %",
        "both 4, only the one in use 1, only the shadow 2",
        "30 looked at, 10 left out (25 %)",
        "earlier by +0.50 s",
        "ended: RuntimeError: x",
    ):
        assert told in text
    assert json.loads(found.line())["only_shadow"] == 2


# In replay


def test_a_replay_counts_the_same_and_decides_the_same(tmp_path: Path) -> None:
    store = PriorStore(tmp_path / "var")
    store.save(prior())
    store.save(blinded(), shadow=True)
    priors = {"apron": store.current("cam", "apron").prior}
    run_replay("pit", camera(), priors, scene(10, 20, 80), "clip.mp4", tmp_path / "alone")
    files = []
    for name in ("once", "again"):
        shadow = ReplayShadow(camera(), store, 2)
        run_replay(
            "pit", camera(), priors, scene(10, 20, 80), "clip.mp4", tmp_path / name, listeners=[shadow.watch]
        )
        shadow.save(tmp_path / name / "shadow.json")
        files.append((tmp_path / name / "shadow.json").read_bytes())
        for file in ("states.jsonl", "alarms.jsonl", "summary.json"):
            assert (tmp_path / name / file).read_bytes() == (tmp_path / "alone" / file).read_bytes()
    assert files[0] == files[1]
    told = ShadowState.model_validate(json.loads(files[0])["apron"])
    assert (told.version, told.current, told.only_current, told.frames) == (2, 1, 1, 110)
    with pytest.raises(ConfigError, match=r"--shadow 7: .*camera cam"):
        ReplayShadow(camera(), store, 7)
