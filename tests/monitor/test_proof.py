"""Proof tests: when they come, where the lump goes, what it looks like, and what becomes of the result."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry
from pydantic import ValidationError

from lumpwatch.models.jdt.row_profile import default_profile
from lumpwatch.models.plane import fit_plane, side_of
from lumpwatch.models.roi import make_roi
from lumpwatch.service.capture.proof_blender import Blender, BlendRequestError
from lumpwatch.service.capture.proof_render import blend, drawn_lump, grain, labelled_lump
from lumpwatch.service.config.proof import ProofTestConfig
from lumpwatch.service.core.clock import Clocks, utc
from lumpwatch.service.core.decision import Decision, Trouble
from lumpwatch.service.core.frame import Encoding
from lumpwatch.service.core.lump_cut import LumpCut
from lumpwatch.service.detection import CameraPipeline, make_region
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.monitor.proof.keeper import ProofError, ProofKeeper
from lumpwatch.service.monitor.proof.lumps import as_message, next_lump, sides_on_belt, stored_lumps
from lumpwatch.service.monitor.proof.mouth import LATE_S, MouthPassage, way_into
from lumpwatch.service.monitor.proof.passage import Ended, Passage, overlaps
from lumpwatch.service.monitor.proof.path import greys_of, make_way, over_profile, reached_lip
from lumpwatch.service.monitor.proof.schedule import is_due, is_overdue
from lumpwatch.service.protocol.proof import BlendPlan, LumpAt, Outcome, ProofReason, ProofResult
from lumpwatch.service.protocol.proof_path import place_at
from lumpwatch.service.storage import PriorStore
from lumpwatch.service.telemetry.proof import ProofMetrics
from tests.detection.test_mouth import Scene as MouthScene
from tests.detection.test_mouth import camera as mouth_camera
from tests.models import test_mouth as mouth
from tests.protocol.test_messages import RESULT
from tests.service_helpers import HEIGHT, POLYGON, WIDTH, camera, frame, learned, lump_fit

SIZE = (640, 480)
ROI = make_roi(((0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)), *SIZE, 320)
HOURLY = ProofTestConfig(every_s=3600.0, retry_s=300.0)


def noon(hour: int = 12, minute: int = 0) -> datetime:
    return datetime(2026, 3, 14, hour, minute, tzinfo=UTC)


# When


def test_without_a_schedule_nothing_is_due() -> None:
    assert not is_due(ProofTestConfig(), noon(), None, conclusive=True)
    assert not is_overdue(ProofTestConfig(), 1e9)


def test_every_so_often_and_sooner_where_it_could_not_be_judged() -> None:
    assert is_due(HOURLY, noon(), None, conclusive=True)
    assert not is_due(HOURLY, noon(), 3599.0, conclusive=True)
    assert is_due(HOURLY, noon(), 3600.0, conclusive=True)
    assert not is_due(HOURLY, noon(), 299.0, conclusive=False)
    assert is_due(HOURLY, noon(), 300.0, conclusive=False)
    assert not is_overdue(HOURLY, 7200.0)
    assert is_overdue(HOURLY, 7201.0)


@given(st.integers(0, 23), st.integers(0, 59), st.floats(0.0, 200_000.0))
def test_times_of_day(hour: int, minute: int, ago_s: float) -> None:
    """Due when a time of day lies between the last try and now."""
    config = ProofTestConfig(at=("06:00", "18:30"))
    now_min = hour * 60 + minute
    passed_s = min((now_min - clock) % 1440 for clock in (360, 1110)) * 60
    assert is_due(config, noon(hour, minute), ago_s, conclusive=True) == (ago_s > passed_s)


@pytest.mark.parametrize(
    "bad", [{"every_s": 60, "at": ["06:00"]}, {"at": ["6:00"]}, {"at": ["24:00"]}, {"at": []}]
)
def test_bad_schedules_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ProofTestConfig.model_validate(bad)


# Where


def test_the_lump_comes_from_above_and_arrives_with_its_lower_edge() -> None:
    """240 px high, 60 px/s, a lump of 48 px: the edge enters at 5 s and is below 240 px after 4 s."""
    profile = default_profile(240.0, 24.0, 96.0, 120.0)
    way = make_way(ROI, profile, SIZE, 5.0)
    first, last = way.path[0], way.path[-1]
    assert first.t_s == 5.0
    assert first.x == pytest.approx(0.5, abs=0.002)
    assert first.y * 480 + first.h * 480 / 2 == pytest.approx(120.0)
    assert last.y * 480 - last.h * 480 / 2 == pytest.approx(360.0, abs=7.0)
    assert way.arrives_s == pytest.approx(9.0, abs=0.11)
    speeds = np.diff([one.y * 480 for one in way.path]) / np.diff([one.t_s for one in way.path])
    assert speeds == pytest.approx(60.0)
    assert first.w * 640 == pytest.approx(48.0)


def test_between_two_moments_it_is_between_two_places() -> None:
    path = (LumpAt(t_s=1.0, x=0.2, y=0.0, w=0.1, h=0.1), LumpAt(t_s=3.0, x=0.4, y=1.0, w=0.2, h=0.1))
    middle = place_at(path, 1.5)
    assert middle is not None
    assert (middle.x, middle.y, middle.w) == pytest.approx((0.25, 0.25, 0.125))
    assert place_at(path, 0.99) is None
    assert place_at(path, 3.01) is None


def test_a_calibrated_lump_has_its_size_and_stops_the_clock_at_the_lip() -> None:
    points = np.array([[220.0, 100.0], [420.0, 100.0], [560.0, 440.0], [80.0, 440.0]])
    belt = np.array([[0.0, 0.0], [2000.0, 0.0], [2000.0, 5000.0], [0.0, 5000.0]])
    plane = fit_plane(points, belt, 1.0, SIZE, np.array([[80.0, 440.0], [560.0, 440.0]]))
    width = side_of(plane, np.array([[320.0, 250.0]]), 900.0)[0]
    assert not reached_lip(plane, np.array([320.0, 250.0, width, width]))
    assert reached_lip(plane, np.array([320.0, 470.0, width, width]))


def test_the_greys_of_a_histogram_are_its_quantiles() -> None:
    greys = greys_of(learned())  # 99 % in the brightest of 16 bins
    assert greys is not None
    assert min(greys) > 239
    assert list(greys) == sorted(greys)
    assert greys_of(learned(likelihood=lump_fit())) is None
    assert greys_of(None) is None


# What it looks like


def test_the_lump_fills_its_box_and_changes_nothing_far_from_it() -> None:
    plane = np.full((300, 400), 90, np.uint8)
    sprite = drawn_lump(np.random.default_rng(3), None)
    blend(plane, sprite, (200.0, 150.0, 80.0, 60.0), (90.0, 20.0), 0.0, np.random.default_rng(1))
    bright = plane > 92  # the shadow only darkens
    rows, columns = np.flatnonzero(bright.any(1)), np.flatnonzero(bright.any(0))
    assert abs(rows.mean() - 149.5) < 6
    assert abs(columns.mean() - 199.5) < 6
    assert 40 <= len(rows) <= 62
    assert 55 <= len(columns) <= 82
    far = np.ones_like(bright)
    far[150 - 60 : 150 + 60, 200 - 80 : 200 + 80] = False
    assert np.all(plane[far] == 90)
    inside = plane[130:170, 175:225]
    assert inside.std() > 5  # it has texture and shading
    assert 95 < inside.mean() < 125  # 90 + 0.9 * 20


@given(st.floats(-150, 550), st.floats(-150, 450), st.floats(1, 300), st.floats(1, 300))
def test_any_place_is_drawn_or_left_out(x: float, y: float, w: float, h: float) -> None:
    plane = np.full((60, 80, 3), 90, np.uint8)
    blend(plane, SPRITE, (x, y, w, h), (90.0, 20.0), 3.0, np.random.default_rng(1))
    if x + w < 0 or y + h < 0 or x - w > 80 or y - h > 60:
        assert np.all(plane == 90)


SPRITE = drawn_lump(np.random.default_rng(3), (10.0, 20.0, 240.0))


def cut(
    name: str = "lump 3 of clip.mp4", box: tuple[float, float, float, float] = (0.5, 0.5, 0.2, 0.1)
) -> LumpCut:
    """Dark stone with a bright spot, 40 x 20 px, on ore of grey 100."""
    picture = np.full((28, 56), 100, np.uint8)
    picture[4:24, 8:48] = 60
    picture[10:14, 20:30] = 200
    return LumpCut(name, picture, box, (100.0, 20.0))


def test_a_labelled_lump_looks_as_it_did_at_any_size_and_in_any_light() -> None:
    sprite = labelled_lump(as_message(cut()))
    for factor in (1, 3):
        plane = np.full((120 * factor, 160 * factor), 100, np.uint8)
        box = (80.0 * factor, 60.0 * factor, 40.0 * factor, 20.0 * factor)
        blend(plane, sprite, box, (100.0, 20.0), 5.0, np.random.default_rng(1))
        assert plane[66 * factor, 70 * factor] == pytest.approx(60, abs=1)
        assert plane[58 * factor, 77 * factor] == pytest.approx(200, abs=20)
        columns = np.flatnonzero((plane < 80).any(0))
        assert (columns[0], columns[-1] + 1) == pytest.approx((60 * factor, 100 * factor), abs=1 + factor)
        assert np.all(plane[: 40 * factor] == 100)
    night = np.full((120, 160), 30, np.uint8)
    blend(night, sprite, (80.0, 60.0, 40.0, 20.0), (30.0, 10.0), 5.0, np.random.default_rng(1))
    assert night[66, 70] == pytest.approx(30 - 2 * 10, abs=1)  # two deviations darker, as it was by day


def test_the_labelled_lumps_come_in_turn_and_one_that_is_missed_again() -> None:
    cuts = [cut("a, the hardest"), cut("b"), cut("c")]

    def after(lump: str, outcome: Outcome) -> str:
        last = ProofResult(site="pit", camera="cam", roi="apron", time=utc(0.0), outcome=outcome, lump=lump)
        chosen = next_lump(cuts, last)
        assert chosen is not None
        return chosen.name

    first = next_lump(cuts, None)
    assert first is not None
    assert first.name == "a, the hardest"
    assert after("", Outcome.PASSED) == "a, the hardest"
    assert [after(name, Outcome.PASSED) for name in ("a, the hardest", "b", "c")] == [
        "b",
        "c",
        "a, the hardest",
    ]
    assert after("b", Outcome.FAILED) == "b"
    assert next_lump([], None) is None


def test_a_labelled_lump_keeps_its_size_beside_that_of_others() -> None:
    """Lumps are 0.1 ROI heights at that row: one of 0.2 x 0.1 is twice as wide as they are, on all its way."""
    profile = default_profile(240.0, 24.0, 24.0, 120.0)
    size_of = over_profile(cut(), profile, 240.0)
    assert size_of == pytest.approx((2.0, 1.0))
    way = make_way(ROI, profile, SIZE, 5.0, size_of=size_of)
    assert way.path[0].w * 640 == pytest.approx(48.0)
    assert way.path[0].h * 480 == pytest.approx(24.0)


def test_on_a_calibrated_belt_a_labelled_lump_keeps_its_diameter_and_is_over_the_limit() -> None:
    points = np.array([[220.0, 100.0], [420.0, 100.0], [560.0, 440.0], [80.0, 440.0]])
    belt = np.array([[0.0, 0.0], [2000.0, 0.0], [2000.0, 5000.0], [0.0, 5000.0]])
    plane = fit_plane(points, belt, 1.0, SIZE, np.array([[80.0, 440.0], [560.0, 440.0]]))
    side = float(side_of(plane, np.array([[320.0, 250.0]]), 900.0)[0])
    wide = np.array([320.0 - side, 250.0 - side / 4, 2 * side, side / 2])  # twice as wide, half as high
    far, near = (sides_on_belt(plane, 600.0, wide, 320.0, y) for y in (250.0, 400.0))
    assert far is not None
    assert near is not None
    assert far == pytest.approx((2 * side, side / 2), rel=0.02)
    assert near[0] / near[1] == pytest.approx(4.0)
    assert near[0] > far[0]
    small = np.array([318.0, 248.0, 4.0, 4.0])
    least = float(side_of(plane, np.array([[320.0, 250.0]]), 660.0)[0])
    assert sides_on_belt(plane, 600.0, small, 320.0, 250.0) == pytest.approx((least, least), rel=0.02)
    assert sides_on_belt(plane, None, small, 320.0, 250.0) is None


def test_lumps_that_cannot_be_read_are_none_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = PriorStore(tmp_path)
    assert stored_lumps(store, "cam", "apron", 1) == ()
    store.folder("cam", "apron").mkdir(parents=True)
    store.keep_lumps("cam", "apron", 1, [cut()])
    (found,) = stored_lumps(store, "cam", "apron", 1)
    assert (found.name, found.box, found.tone) == (cut().name, cut().box, cut().tone)
    assert np.array_equal(found.picture, cut().picture)
    assert not caplog.records
    path = store.path("cam", "apron", 1).with_suffix(".lumps")
    path.write_bytes(path.read_bytes()[:-1])
    assert stored_lumps(store, "cam", "apron", 1) == ()
    assert "truncated" in caplog.text


def test_grain_is_the_noise_of_the_picture() -> None:
    rng = np.random.default_rng(4)
    clean = np.full((256, 256), 120.0)
    clean[64:128, 64:128] = 200.0
    noisy = np.clip(np.rint(clean + rng.normal(0, 6.0, clean.shape)), 0, 255).astype(np.uint8)
    assert grain(noisy) == pytest.approx(6.0, rel=0.2)
    assert grain(clean.astype(np.uint8)) == 0.0


# In the camera's process


def plan(**other: object) -> bytes:
    path = [
        {"t_s": 1.0, "x": 0.5, "y": 0.5, "w": 0.3, "h": 0.4},
        {"t_s": 2.0, "x": 0.5, "y": 0.6, "w": 0.3, "h": 0.4},
    ]
    return json.dumps({"roi": "apron", "path": path, "lasts_s": 2.5} | other).encode()


@pytest.mark.parametrize("encoding", ["gray8", "i420", "bgr8"])
def test_copies_of_the_frames_carry_the_lump_and_the_frames_do_not(encoding: Encoding) -> None:
    blender = Blender(camera())
    shape = {"gray8": (HEIGHT, WIDTH), "i420": (HEIGHT * 3 // 2, WIDTH), "bgr8": (HEIGHT, WIDTH, 3)}[encoding]

    def one(time_s: float) -> tuple[bool, bool]:
        """Whether there is a frame, and whether it has a lump."""
        data = np.full(shape, 40, np.uint8)
        made = blender.frame(frame(int(time_s * 10), time_s=time_s, data=data, encoding=encoding))
        assert np.all(data == 40)
        if made is None:
            return False, False
        assert made.data.shape == shape
        if encoding == "i420":
            assert np.all(made.data[HEIGHT:] == 40)  # chroma stays
        return True, bool(np.any(made.data > 60))

    assert one(9.0) == (False, False)
    assert json.loads(blender.request({}, plan(greys=[200.0, 250.0]))) == {"accepted": True}
    assert one(10.0) == (True, False)
    assert one(10.9) == (True, False)
    assert one(11.5) == (True, True)
    assert one(12.2) == (True, False)
    assert one(12.6) == (False, False)
    assert one(12.7) == (False, False)


@pytest.mark.parametrize(
    ("payload", "told"),
    [
        (b"", "payload"),
        (b"nonsense", "payload"),
        (plan(roi="lip"), "roi: camera cam has no 'lip'"),
        (plan(lasts_s=0), "lasts_s"),
        (plan(path=[]), "path"),
        (plan(lump={"width": 8, "height": 8, "luma": "AAAA", "mean": 9, "spread": 9}), "lump: .*base64"),
        (plan(lump={"width": 9999, "height": 8, "luma": "AAAA", "mean": 9, "spread": 9}), "lump.width"),
    ],
)
def test_a_bad_plan_is_refused_in_one_line(payload: bytes, told: str) -> None:
    with pytest.raises(BlendRequestError, match=told) as caught:
        Blender(camera()).request({}, payload)
    assert "\n" not in str(caught.value)


# What the result means


def passage(least_s: float = 0.0) -> Passage:
    config = camera().rois[0]
    return Passage(config.model_copy(update={"proof_test": ProofTestConfig(least_warning_s=least_s)}))


# RESULT raises an alarm; its object is the box 101..131 x 50..70 of the picture.
FRAME = frame(41, time_s=100.0, size=(WIDTH, HEIGHT))
WAY = make_way(
    make_roi(POLYGON, WIDTH, HEIGHT, 96), default_profile(48.0, 6.0, 24.0, 24.0), (WIDTH, HEIGHT), 5.0
)


def test_an_alarm_in_time_passes_and_says_how_much_was_left() -> None:
    place = place_at(WAY.path, 7.0)
    assert place is not None
    assert RESULT.detection is not None
    x, y, w, h = place.x * WIDTH, place.y * HEIGHT, place.w * WIDTH, place.h * HEIGHT
    on_it = replace(RESULT.detection.objects[0], x=x - w / 2, y=y - h / 2, w=w, h=h)
    seen = replace(RESULT, detection=replace(RESULT.detection, objects=(on_it,)))
    one = passage()
    one.take(replace(seen, changes=()), FRAME, WAY, 6.0, (WIDTH, HEIGHT), 100.1)
    assert one.outcome is Outcome.FAILED
    one.take(seen, FRAME, WAY, 7.0, (WIDTH, HEIGHT), 100.1)
    assert (one.outcome, one.reason) == (Outcome.PASSED, None)
    assert one.warning_s == pytest.approx(WAY.arrives_s - 7.0 - 0.1)
    late = passage(60.0)
    late.take(seen, FRAME, WAY, 7.0, (WIDTH, HEIGHT), 100.1)
    assert (late.outcome, late.reason) == (Outcome.FAILED, ProofReason.TOO_LATE)


def test_an_alarm_before_or_beside_the_lump_cannot_be_judged() -> None:
    for t_s in (4.0, 7.0):  # before it; and far from the object of RESULT
        with pytest.raises(Ended) as end:
            passage().take(RESULT, FRAME, WAY, t_s, (WIDTH, HEIGHT), 100.1)
        assert (end.value.outcome, end.value.reason) == (Outcome.INCONCLUSIVE, ProofReason.DISTURBED)


def test_overlap() -> None:
    size = (200, 100)
    assert overlaps(RESULT, LumpAt(t_s=0.0, x=0.58, y=0.6, w=0.1, h=0.1), size)
    assert not overlaps(RESULT, LumpAt(t_s=0.0, x=0.2, y=0.6, w=0.1, h=0.1), size)
    assert not overlaps(replace(RESULT, detection=None), LumpAt(t_s=0.0, x=0.58, y=0.6, w=0.1, h=0.1), size)


class World:
    """A chain that gives the results it is told, and the clocks."""

    def __init__(self, store: Path, config: ProofTestConfig = HOURLY) -> None:
        roi = camera().rois[0].model_copy(update={"proof_test": config})
        self.camera = camera().model_copy(update={"rois": (roi,)})
        self.store = store
        self.now_s = 50.0
        self.outcome, self.reason = Outcome.PASSED, None
        self.registry = CollectorRegistry()
        self.ran: list[str] = []
        self.last: ProofResult | None = None
        self.meanwhile: Callable[[str, str], None] = lambda roi, actor: None
        self.keeper = self.made()

    def made(self) -> ProofKeeper:
        self.registry = CollectorRegistry()
        metrics = ProofMetrics(self.registry, "cam", ("apron",))
        return ProofKeeper(self.camera, self.store, self.run, metrics, self.clocks)

    def clocks(self) -> Clocks:
        return Clocks(self.now_s, 1.7e9 + self.now_s)

    def run(self, roi: str, actor: str, last: ProofResult | None) -> ProofResult:
        self.last = last
        self.ran.append(roi)
        self.meanwhile(roi, actor)
        return ProofResult(
            site="pit",
            camera="cam",
            roi=roi,
            time=utc(self.clocks().wall_s),
            outcome=self.outcome,
            actor=actor,
        )

    def troubles(self) -> set[Trouble]:
        return {what for what, present in self.keeper.troubles("apron").items() if present}

    def metric(self, name: str) -> float | None:
        return self.registry.get_sample_value(name, {"camera": "cam", "roi": "apron"})


def test_a_failure_is_a_trouble_until_a_test_passes_over_restarts_too(tmp_path: Path) -> None:
    world = World(tmp_path)
    world.outcome = Outcome.FAILED
    result = world.keeper.test("apron", "anna")
    assert (result.outcome, result.actor) == (Outcome.FAILED, "anna")
    assert world.troubles() == {Trouble.PROOF_TEST}
    ended_s = world.clocks().wall_s
    world.now_s += 100.0
    world.keeper = world.made()
    assert world.troubles() == {Trouble.PROOF_TEST}
    world.keeper.poll()
    assert world.metric("lumpwatch_proof_test_timestamp_seconds") == pytest.approx(ended_s)
    assert world.metric("lumpwatch_proof_test_passed") == 0
    world.outcome = Outcome.INCONCLUSIVE
    world.keeper.test("apron", "")
    assert world.troubles() == {Trouble.PROOF_TEST}
    world.outcome = Outcome.PASSED
    world.keeper.test("apron", "")
    assert world.troubles() == set()
    assert world.metric("lumpwatch_proof_test_passed") == 1


def test_no_result_for_too_long_is_a_trouble(tmp_path: Path) -> None:
    world = World(tmp_path)
    world.now_s += 7200.0
    assert world.troubles() == set()
    world.now_s += 1.0
    assert world.troubles() == {Trouble.PROOF_OVERDUE}
    world.outcome = Outcome.INCONCLUSIVE
    world.keeper.test("apron", "")
    assert world.troubles() == {Trouble.PROOF_OVERDUE}
    world.outcome = Outcome.FAILED
    world.keeper.test("apron", "")
    assert world.troubles() == {Trouble.PROOF_TEST}


def test_one_test_at_a_time(tmp_path: Path) -> None:
    world = World(tmp_path)

    def meanwhile(roi: str, actor: str) -> None:
        with pytest.raises(ProofError, match="another"):
            world.keeper.test(roi, actor)

    world.meanwhile = meanwhile
    assert world.keeper.test("apron", "").outcome is Outcome.PASSED
    assert world.keeper.test("apron", "").outcome is Outcome.PASSED


def test_a_damaged_result_is_none(tmp_path: Path) -> None:
    (tmp_path / "proof" / "cam").mkdir(parents=True)
    (tmp_path / "proof" / "cam" / "apron.json").write_bytes(b"\x00{")
    assert World(tmp_path).troubles() == set()


def test_a_plan_must_go_forward() -> None:
    with pytest.raises(ValidationError, match="do not rise"):
        BlendPlan(
            roi="apron",
            lasts_s=1.0,
            path=(LumpAt(t_s=1.0, x=0, y=0, w=0.1, h=0.1), LumpAt(t_s=1.0, x=0, y=0, w=0.1, h=0.1)),
        )


# Of a mouth


def test_a_lump_that_stays_in_the_mouth_raises_the_blocked_alarm_in_time() -> None:
    """As the camera's process draws it, through a chain that goes on from what the live one has learned."""
    config = mouth_camera()
    roi = config.rois[0]
    live, size = MouthScene(config), (mouth.WIDTH, mouth.HEIGHT)
    list(live.look(10.0))
    way = way_into(make_region(roi, *size), roi, size)
    blender = Blender(config)
    blender.request({}, BlendPlan(roi="mouth", path=way.path, lasts_s=way.path[-1].t_s + 1.0).line())
    tested = CameraPipeline(config)
    tested.restore("mouth", live.pipeline.snapshots()["mouth"])
    passage = MouthPassage(roi)
    for result in live.look(20.0):
        assert result.frame is not None
        made = blender.frame(result.frame)
        if made is None:
            break
        t_s = result.frame.capture_s - 10.0
        for one in tested.process(made, made.capture_s):
            passage.take(one, made, way, t_s, size, made.capture_s)
        assert result.decision is Decision.CLEAR  # the live chain sees nothing of it
    assert passage.outcome is Outcome.PASSED
    assert passage.warning_s is not None
    assert 0.0 < passage.warning_s <= LATE_S


def test_a_mouth_with_a_delay_that_no_test_outlasts_is_refused() -> None:
    roi = mouth_camera().rois[0]
    blocked = roi.alarm.blocked.model_copy(update={"on_delay_s": 900.0})
    slow = roi.model_copy(update={"alarm": roi.alarm.model_copy(update={"blocked": blocked})})
    with pytest.raises(LumpwatchError, match="longer than a proof test may last"):
        way_into(ROI, slow, SIZE)


def test_an_alarm_before_the_lump_has_come_to_rest_cannot_be_judged() -> None:
    config = mouth_camera()
    roi = config.rois[0]
    scene, size = MouthScene(config), (mouth.WIDTH, mouth.HEIGHT)
    way = way_into(make_region(roi, *size), roi, size)
    list(scene.look(10.0))
    raised = next(r for r in scene.look(15.0, 0.0) if any(c.alarm_class == "blocked" for c in r.changes))
    assert raised.frame is not None
    with pytest.raises(Ended) as ended:
        MouthPassage(roi).take(raised, raised.frame, way, 1.0, size, raised.frame.capture_s)
    assert (ended.value.outcome, ended.value.reason) == (Outcome.INCONCLUSIVE, ProofReason.DISTURBED)
