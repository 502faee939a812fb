"""The checks of one camera in the pipeline: what is found, what is followed, what the lump alarm may judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from lumpwatch.models.picture.region import Measure
from lumpwatch.models.roi import Image, make_roi
from lumpwatch.service.bus.codec import decode_header, decode_pixels, encode_frame, encode_jpeg
from lumpwatch.service.capture.camera_process import Reducer
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.config.quality import QualityConfig
from lumpwatch.service.core.decision import BlindReason, Decision, RoiResult
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.camera_shift import CameraShift
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.storage.reference_store import (
    BadReferenceError,
    Reference,
    ReferenceStore,
    decode,
    encode,
)
from lumpwatch.service.training.picture_reference import FootageError, Recording, learn_reference
from tests.belt_scene import (
    CONFIG,
    FPS,
    HEIGHT,
    REFERENCE,
    WHEN,
    WIDTH,
    belt,
    blurred,
    camera,
    dark,
    dusty,
    every_frame,
    frames,
    frozen,
    learned,
    plate,
    turned,
    white,
)
from tests.service_helpers import prior


def results(
    fault: Callable[[Image, int], Image],
    reference: Reference | None = REFERENCE,
    config: CameraConfig = CONFIG,
    begin: int = 50,
    end: int = 100,
    count: int = 150,
) -> tuple[list[RoiResult], CameraPipeline]:
    """Ten seconds without the fault, ten with it, ten without."""
    pipeline = CameraPipeline(config, {"apron": prior()}, reference=reference)
    shown = (fault(belt(200 + k), k) if begin <= k < end else belt(200 + k) for k in range(count))
    return [pipeline.process(one, one.received_s)[0] for one in frames(shown)], pipeline


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (blurred, BlindReason.BLURRED),
        (dusty, BlindReason.DUSTY),
        (dark, BlindReason.DARK),
        (white, BlindReason.GLARE),
        (plate, BlindReason.HIDDEN),
        (frozen, BlindReason.FROZEN),
        (turned, BlindReason.MOVED),
    ],
    ids=lambda one: getattr(one, "__name__", ""),
)
def test_a_fault_is_found_in_its_time_and_forgotten(
    fault: Callable[[Image, int], Image], reason: BlindReason
) -> None:
    found, _ = results(fault)
    assert [one.reason for one in found[:50]] == [None] * 50
    within = CONFIG.quality.found_within_s(getattr(CONFIG.quality, reason.value))
    first = next(k for k in range(50, 100) if found[k].reason is reason)
    assert (first - 50) / FPS <= within
    assert all(one.decision is Decision.BLIND for one in found[first:100])
    assert all(one.reason is None and one.fit for one in found[145:])
    assert not any(one.fit for one in found[first:100])


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (lambda p, k: np.zeros_like(p), BlindReason.DARK),
        (white, BlindReason.GLARE),
        (lambda p, k: np.full_like(p, 128), BlindReason.FROZEN),
        (lambda p, k: (p // 64 + 128).astype(np.uint8), BlindReason.HIDDEN),
        (frozen, BlindReason.FROZEN),
    ],
    ids=["black", "white", "grey", "without structure", "frozen"],
)
def test_gross_faults_are_found_without_a_reference(
    fault: Callable[[Image, int], Image], reason: BlindReason
) -> None:
    found, pipeline = results(fault, None)
    assert reason in {one.reason for one in found[50:100]}
    assert found[99].decision is Decision.BLIND
    assert found[49].reason is found[149].reason is None
    assert pipeline.quality.shift.shift_px is None


@pytest.mark.parametrize("interval_s", [0.5, 1.6, 2.9])
def test_pictures_that_seldom_come_can_be_frozen_too(interval_s: float) -> None:
    pipeline = CameraPipeline(CONFIG, {"apron": prior()}, reference=REFERENCE)
    shown = [belt(200 + k) if k < 20 else frozen(belt(0), 5 * k) for k in range(40)]
    found = []
    for k, one in enumerate(frames(iter(shown))):
        came = replace(one, capture_s=k * interval_s, received_s=k * interval_s)
        found.append(pipeline.process(came, came.received_s)[0].reason)
    assert set(found[:20]) == {None}
    first = found.index(BlindReason.FROZEN)
    assert (first - 20) * interval_s <= CONFIG.quality.found_within_s(CONFIG.quality.frozen) + 2 * interval_s
    assert set(found[first:]) == {BlindReason.FROZEN}


def test_a_stopped_belt_under_a_live_sensor_is_not_frozen() -> None:
    found, _ = results(lambda p, k: belt(k, run=False))
    assert not [one.reason for one in found if one.reason is BlindReason.FROZEN]
    assert {one.reason for one in found} <= {None}


def test_what_is_switched_off_is_not_found() -> None:
    config = camera(frozen={"enabled": False})
    found, _ = results(frozen, learned(config), config)
    assert {one.reason for one in found} == {None}
    config = camera(enabled=False)
    found, _ = results(dark, None, config)
    assert {one.reason for one in found} == {None}
    assert found[-1].quality.values == {}


# A camera that moves


def test_a_small_shift_is_followed_and_its_objects_stay_where_they_are() -> None:
    shifted, pipeline = results(lambda p, k: np.roll(p, (2, 3), (0, 1)), end=150)
    assert pipeline.quality.shift.followed_px == (3, 2)
    assert pipeline.quality.shift.follows == 1
    assert {one.reason for one in shifted} == {None}
    detector = pipeline.detector("apron")
    assert detector is not None
    roi, offset = pipeline.quality.shift.placed(detector.roi, WIDTH, HEIGHT)
    assert offset == (3, 2)
    assert (roi.x, roi.y) == (detector.roi.x + 3, detector.roi.y + 2)
    assert np.allclose(roi.corners, detector.roi.corners + np.array([3, 2]))


def test_a_region_goes_back_to_where_it_was_with_the_camera() -> None:
    _, pipeline = results(lambda p, k: np.roll(p, (2, 3), (0, 1)), end=100, count=160)
    assert (pipeline.quality.shift.followed_px, pipeline.quality.shift.follows) == ((0, 0), 2)


def test_what_is_left_of_a_shift_once_the_camera_is_back_is_the_error_of_the_estimate() -> None:
    # A still that was learned half a pixel of the thumbnail off: no estimate ever is 0, 0.
    shift = CameraShift("cam", QualityConfig())
    rois = {"apron": make_roi(CONFIG.rois[0].polygon, WIDTH, HEIGHT, 320)}
    (light,) = REFERENCE.lights
    matrix = np.array([[1.0, 0.0, 0.45], [0.0, 1.0, 0.45]])
    off = np.asarray(cv2.warpAffine(light.still, matrix, light.still.shape[::-1]), np.uint8)
    shift.fit(rois, WIDTH, HEIGHT, replace(REFERENCE, lights=(replace(light, still=off),)))
    places = []
    for k, one in enumerate(
        frames(np.roll(belt(k), (3, 3) if k < 60 else (0, 0), (0, 1)) for k in range(150))
    ):
        shift.observe(one, 0)
        places.append(shift.followed_px)
        assert not shift.lost, k
    assert places[59] != (0, 0)
    assert shift.shift_px is not None
    assert max(abs(one) for one in shift.shift_px) > 0.5  # which would be rounded to a pixel
    assert places[-1] == (0, 0)


def test_a_region_does_not_follow_beyond_the_picture() -> None:
    _, pipeline = results(lambda p, k: np.roll(p, (-2, -3), (0, 1)), end=150)
    detector = pipeline.detector("apron")
    assert detector is not None
    at_the_edge = detector.roi.at(0, 1)
    assert pipeline.quality.shift.placed(at_the_edge, WIDTH, HEIGHT)[1] == (0, -1)


def test_a_cut_frame_gives_the_same_results_with_a_camera_that_moved() -> None:
    # Over the bus only the regions travel, with a margin for following and a thumbnail of the whole.
    reduce = Reducer(CONFIG)
    whole = CameraPipeline(CONFIG, {"apron": prior()}, reference=REFERENCE)
    parts = CameraPipeline(CONFIG, {"apron": prior()}, reference=REFERENCE)
    for one in frames(np.roll(belt(300 + k), (2, 3), (0, 1)) for k in range(60)):
        payload, header = encode_frame(reduce(one), "clock")
        cut = decode_pixels(payload, decode_header(header))
        assert cut.crop is not None
        (a,), (b,) = whole.process(one, one.received_s), parts.process(cut, one.received_s)
        assert (a.reason, a.existence, a.quality) == (b.reason, b.existence, b.quality)
    assert parts.quality.shift.followed_px == (3, 2)


def test_a_thumbnail_travels_as_it_is() -> None:
    thumb = np.arange(48, dtype=np.uint8).reshape(6, 8)
    one = replace(next(frames(iter([belt(0)]))), thumb=thumb)
    for payload, header in (encode_frame(one, "clock"), encode_jpeg(one, 90, "clock")):
        again = decode_pixels(payload, decode_header(header)).thumb
        assert again is not None
        assert np.array_equal(again, thumb)


# The exposure


def darker(picture: Image, k: int) -> Image:
    return (0.65 * picture).astype(np.uint8)


def test_a_jump_of_the_exposure_is_a_counted_hold_off() -> None:
    found, _ = results(darker)
    held = [k for k, one in enumerate(found) if one.reason is BlindReason.EXPOSURE]
    # A second from the jump on; in the half second after it the level before is still remembered.
    assert held[0] == 50
    assert 100 in held
    assert len([k for k in held if k < 100]) in range(5, 9)
    assert found[-1].quality.holdoffs == 2
    assert all(one.quality.held_off for k, one in enumerate(found) if k in held)


# What the lump alarm may judge


def lump(*, shown: bool, k: int) -> Image:
    """With a white stone of 28 x 28 px, which the helper's prior looks for."""
    picture = belt(k)
    picture = (picture * 0.7).astype(np.uint8)
    if shown:
        picture[50:78, 82:110] = 250
    return picture


def test_a_picture_that_is_not_fit_clears_no_alarm() -> None:
    config = camera(exposure={"enabled": False})
    pipeline = CameraPipeline(config, {"apron": prior()})
    shown = [lump(shown=True, k=k) for k in range(30)] + [np.zeros((HEIGHT, WIDTH), np.uint8)] * 60
    shown += [lump(shown=False, k=k) for k in range(60)]
    found = [pipeline.process(one, one.received_s)[0] for one in frames(iter(shown))]
    assert found[29].decision is Decision.LUMP
    first = next(k for k, one in enumerate(found) if one.reason is BlindReason.DARK)
    assert first < 50
    assert all(one.alarm.active for one in found[first:90])
    assert all(one.decision is Decision.BLIND for one in found[first:90])
    assert (found[-1].decision, found[-1].alarm.active) == (Decision.CLEAR, False)


# The filter and the load


def test_too_few_frames_or_late_ones_are_overload() -> None:
    config = every_frame(camera(overload={"longest_age_s": 0.5}))
    quality = config.quality
    for step, age_s, reason in ((1, 0.0, None), (10, 0.0, "overload"), (1, 0.8, "overload"), (4, 0.4, None)):
        pipeline = CameraPipeline(config, {"apron": prior()})
        last = None
        for k in range(60):
            one = Frame(k * step, k / FPS, k / FPS, 0.0, WIDTH, HEIGHT, "gray8", belt(k))
            (last,) = pipeline.process(one, one.received_s + age_s)
        assert last is not None
        assert last.reason == reason, (step, age_s)
    assert quality.found_within_s(quality.overload) < 12.0


def test_a_starved_filter_is_blind() -> None:
    pipeline = CameraPipeline(CONFIG, {"apron": prior()})
    (result,) = [pipeline.process(one, one.received_s)[0] for one in frames(iter([belt(0)]))]
    assert result.detection is not None
    detector = pipeline.detector("apron")
    assert detector is not None
    for effective, reason in (
        (300.0, None),
        (1.2, BlindReason.FILTER),
        (0.0, None),
        (float("nan"), BlindReason.FILTER),
    ):
        checks = CameraQuality("cam", QualityConfig(), ("apron",))
        checks.fit({"apron": detector.roi}, WIDTH, HEIGHT, None)
        for k in range(60):
            checks.filtered("apron", replace(result.detection, effective_particles=effective), k / FPS)
        assert checks.current("apron").reason is reason, effective


# Footage and the store


def test_a_reference_comes_back_from_the_store(tmp_path: Any) -> None:
    store = ReferenceStore(tmp_path)
    assert store.current("cam").reference is None
    stored = store.save(REFERENCE)
    again = store.current("cam").reference
    assert again is not None
    assert (stored.version, again.version) == (1, 1)
    assert encode(again) == encode(REFERENCE)
    assert again.lights[0].regions["apron"].thresholds == REFERENCE.lights[0].regions["apron"].thresholds


def test_a_damaged_reference_falls_back_to_the_one_before(tmp_path: Any) -> None:
    store = ReferenceStore(tmp_path)
    store.save(REFERENCE)
    path = store.versions("cam").path(store.save(REFERENCE).version)
    path.write_bytes(path.read_bytes()[:-7])
    found = store.current("cam")
    assert found.reference is not None
    assert found.reference.version == 1
    assert "is truncated" in found.problems[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: b"lumpwatch-prior" + c[19:], "is not a lumpwatch reference"),
        (lambda c: c.replace(b"lumpwatch-reference 1", b"lumpwatch-reference 9"), "has format 9"),
        (lambda c: c[:-1] + bytes([c[-1] ^ 1]), "is corrupt"),
    ],
)
def test_what_is_no_reference_is_refused(change: Callable[[bytes], bytes], message: str) -> None:
    with pytest.raises(BadReferenceError, match=message):
        decode(change(encode(REFERENCE)), "000001.reference")


def test_a_reference_for_another_region_is_refused_and_defaults_are_used(
    caplog: pytest.LogCaptureFixture,
) -> None:
    meta = REFERENCE.meta.model_copy(update={"polygons": {"apron": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))}})
    pipeline = CameraPipeline(CONFIG, {"apron": prior()}, reference=replace(REFERENCE, meta=meta))
    (one,) = frames(iter([belt(0)]))
    pipeline.process(one, 0.0)
    unused = pipeline.reference
    assert unused is None
    assert "another roi apron" in caplog.text
    pipeline.use_reference(replace(REFERENCE, version=4))
    assert pipeline.reference is not None
    pipeline.use_reference(replace(REFERENCE, meta=meta))
    assert pipeline.reference.version == 4


def test_footage_without_pictures_is_named() -> None:
    with pytest.raises(FootageError, match=r"empty\.mp4: .*no picture"):
        learn_reference(CONFIG, {"day": [Recording("empty.mp4", iter(()))]}, 1e-3, WHEN)


def test_short_and_still_footage_is_warned_of() -> None:
    still = Recording("still.mp4", frames(belt(0) for _ in range(20)))
    warnings = learn_reference(CONFIG, {"day": [still]}, 1e-3, WHEN).warnings
    assert "only 4 s of footage" in warnings[0]
    assert "stands still" in warnings[1]


def test_night_is_judged_by_the_night() -> None:
    def night(k: int) -> Image:
        lamp = np.exp(-np.hypot(*(np.mgrid[:HEIGHT, :WIDTH] - np.array([[[60]], [[90]]]))) / 60)
        return np.clip(belt(k) * (0.1 + 0.5 * lamp), 0, 255).astype(np.uint8)

    recordings = {
        "day": [Recording("day.mp4", frames(belt(k) for k in range(100)))],
        "night": [Recording("night.mp4", frames(night(k) for k in range(100)))],
    }
    reference = learn_reference(CONFIG, recordings, 1e-3, WHEN).reference
    pipeline = CameraPipeline(CONFIG, {"apron": prior()}, reference=reference)
    shown = [belt(k) for k in range(200, 250)] + [night(k) for k in range(250, 300)]
    found = [pipeline.process(one, one.received_s)[0] for one in frames(iter(shown))]
    assert {one.reason for one in found[80:]} == {None}
    thresholds = [one.quality.thresholds[Measure.BRIGHT] for one in (found[40], found[99])]
    assert thresholds[1] < thresholds[0]


def test_a_camera_that_trembles_has_not_moved() -> None:
    """Three pixels at 12 Hz, as of a crusher beside it: looks at even distances would catch one phase of it."""
    shift = CameraShift("cam", QualityConfig())
    rois = {"apron": make_roi(CONFIG.rois[0].polygon, WIDTH, HEIGHT, 320)}
    shift.fit(rois, WIDTH, HEIGHT, REFERENCE)
    trembling = (round(3 * np.sin(2 * np.pi * 12.0 * k / 10.0 + 1.57)) for k in range(400))
    for one in frames(np.roll(belt(k), (y, 0), (0, 1)) for k, y in enumerate(trembling)):
        shift.observe(one, 0)
    assert shift.follows == 0
