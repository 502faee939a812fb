"""Running, stopped, empty: on simulated belts with truth, and what the plant's signal is compared with."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from lumpwatch.models.roi import make_roi
from lumpwatch.service.config import CalibrationConfig, FeedConfig
from lumpwatch.service.core import FeedState, FeedStatus, PlantFeed
from lumpwatch.service.detection.feed_watch import FeedWatch
from lumpwatch.service.detection.plant_signal import PlantSignal
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from tests.detection.filmed_belts import filmed

SETTLES_S = 1.0


def calibration(feed: FeedSimulator) -> CalibrationConfig:
    spec, geometry = feed.spec, feed.geometry
    half, length = 0.45 * spec.belt_width_mm, spec.belt_length_mm
    places = [(-half, 0.05 * length), (half, 0.05 * length), (half, 0.95 * length), (-half, 0.95 * length)]
    size = (spec.width, spec.height)
    return CalibrationConfig.model_validate(
        {
            "points": (geometry.to_px(places) / size).tolist(),
            "points_mm": places,
            "lip": (geometry.to_px([(-half, length), (half, length)]) / size).tolist(),
        }
    )


def truth(feed: FeedSimulator, t: float) -> FeedState:
    belt = feed.belt_at(t)
    if belt.load < 0.1:
        return FeedState.EMPTY
    return FeedState.STOPPED if belt.speed_mm_s < 30.0 else FeedState.RUNNING


def shares(spec: FeedSpec, seconds: float) -> tuple[float, set[FeedState], float]:
    """Share of the pictures that are judged rightly, what there was, and the worst error of a speed.

    Left out are those within a second of a change, and loads around the thresholds: far away a cell shows a tenth of
    the belt.
    """
    feed = FeedSimulator(spec)
    size = (spec.width, spec.height)
    roi = make_roi(feed.polygon, *size, 320)
    watch = FeedWatch(FeedConfig(), calibration(feed), roi, size)
    right, told, was, errors = 0, 0, set(), []
    for _ in range(round(seconds * spec.fps)):
        t = feed.time_s
        watch.step(roi.cut(feed.render()[0]), t)
        steady = {truth(feed, max(t - SETTLES_S * k / 8, 0.0)) for k in range(9)}
        belt = feed.belt_at(t)
        if t < SETTLES_S or len(steady) > 1 or 0.03 <= belt.load < 0.2:
            continue
        (state,) = steady
        was.add(state)
        told += 1
        right += watch.status.state is state
        if state is FeedState.RUNNING and watch.status.speed_mm_s is not None and spec.speed_change == 0:
            errors.append(abs(watch.status.speed_mm_s - belt.speed_mm_s) / belt.speed_mm_s)
    errors.sort()
    return right / told, was, errors[len(errors) // 2]


SCENES: dict[str, dict[str, object]] = {
    "plain": {"seed": 2},
    "dust, noise and shake": {"seed": 5, "style": "b", "dust": 0.6, "noise": 5.0, "shake_px": 1.5},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_states_are_right_outside_a_second_of_a_change(name: str) -> None:
    spec = FeedSpec.model_validate(
        {
            "fps": 10.0,
            "width": 400,
            "height": 300,
            "stop_every_s": 9.0,
            "stop_duration_s": 4.0,
            "empty_every_s": 12.0,
            "empty_duration_s": 13.0,
            **SCENES[name],
        }
    )
    share, was, error = shares(spec, 45.0)
    assert was == {FeedState.RUNNING, FeedState.STOPPED, FeedState.EMPTY}
    assert share >= 0.99
    assert error < 0.05


def test_a_belt_that_stops_is_said_to_and_its_speed_is_zero() -> None:
    feed = FeedSimulator(
        FeedSpec(seed=1, fps=10.0, width=400, height=300, stop_every_s=8.0, stop_duration_s=6.0)
    )
    roi = make_roi(feed.polygon, 400, 300, 320)
    watch = FeedWatch(FeedConfig(), calibration(feed), roi, (400, 300))
    assert watch.status == FeedStatus()
    while feed.belt_at(feed.time_s).speed_mm_s > 0 or feed.time_s < 2.0:
        watch.step(roi.cut(feed.render()[0]), feed.time_s)
        if feed.time_s > 1.5 and feed.belt_at(feed.time_s - 1.0).speed_mm_s == feed.spec.belt_speed_mm_s:
            assert watch.status.state is FeedState.RUNNING
    stopped_s = feed.time_s
    while feed.time_s < stopped_s + 1.0:
        watch.step(roi.cut(feed.render()[0]), feed.time_s)
    assert (watch.status.state, watch.status.speed_mm_s, watch.status.speed_px_s) == (
        FeedState.STOPPED,
        0.0,
        0.0,
    )
    assert watch.status.since_s == pytest.approx(stopped_s, abs=1.0)


def test_pictures_that_tell_nothing_make_the_state_unknown_and_no_zero() -> None:
    feed = FeedSimulator(FeedSpec(seed=1, fps=10.0, width=400, height=300))
    roi = make_roi(feed.polygon, 400, 300, 320)
    watch = FeedWatch(FeedConfig(unknown_after_s=1.0), calibration(feed), roi, (400, 300))
    for _ in range(15):
        watch.step(roi.cut(feed.render()[0]), feed.time_s)
    before = watch.status.state
    rng = np.random.default_rng(0)
    for k in range(15):  # every picture has nothing to do with the one before
        field = cv2.GaussianBlur(rng.standard_normal(roi.shape).astype(np.float32), (0, 0), 2.0)
        watch.step(np.clip(100 + 150 * field, 0, 255).astype(np.uint8), feed.time_s + 0.3 * k)
    assert (before, watch.status.state) == (FeedState.RUNNING, FeedState.UNKNOWN)
    assert (watch.status.speed_mm_s, watch.status.speed_px_s) == (None, None)


POLYGON = [(0.1, 0.0), (0.9, 0.0), (0.9, 1.0), (0.1, 1.0)]
SIZE = (240, 180)


def smooth(k: int, grid: float) -> np.ndarray:
    """Fines that no camera resolves, or bare rubber: light that falls off, noise, a monitor's grid that stands."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    light = 110.0 - 0.1 * y + grid * (np.sin(0.9 * x) + np.sin(0.5 * y + 0.4 * x))
    return np.clip(light + np.random.default_rng(k).normal(0.0, 0.7, light.shape), 0, 255).astype(np.uint8)


def coarse(k: int, rows: slice = slice(None)) -> np.ndarray:
    """The same with ore in these rows, 6 px further in each picture."""
    field = cv2.GaussianBlur(np.random.default_rng(9).normal(size=(900, SIZE[0])), (0, 0), 2.0)
    ore = np.roll(110.0 + 25.0 * field / field.std(), 6 * k, axis=0)[: SIZE[1]]
    picture = smooth(k, 0.0)
    picture[rows] = np.clip(ore, 0, 255)[rows]
    return picture


def states(pictures: Iterable[np.ndarray], bare_below: float = 0.03) -> list[FeedState]:
    """What is said after each, ten a second."""
    roi = make_roi(POLYGON, *SIZE, 320)
    watch = FeedWatch(FeedConfig(bare_below=bare_below, unknown_after_s=1.0), None, roi, SIZE)
    said = []
    for k, picture in enumerate(pictures):
        watch.step(roi.cut(picture), 0.1 * k)
        said.append(watch.status.state)
    return said


@pytest.mark.parametrize("grid", [0.0, 0.7])
@pytest.mark.parametrize("bare_below", [0.03, 0.004, 0.001])
def test_a_smooth_belt_is_unknown_where_nothing_is_known_to_have_passed(
    bare_below: float, grid: float
) -> None:
    assert set(states((smooth(k, grid) for k in range(40)), bare_below)) == {FeedState.UNKNOWN}


def test_a_smooth_belt_is_empty_where_coarse_ore_has_passed() -> None:
    said = states([*(coarse(k) for k in range(20)), *(smooth(k, 0.7) for k in range(20))])
    assert (said[19], said[-1]) == (FeedState.RUNNING, FeedState.EMPTY)


def test_one_lump_in_fines_does_not_make_the_fines_a_bare_belt() -> None:
    lump = (coarse(k, slice(8 * k, 8 * k + 40)) for k in range(20))
    said = states([*lump, *(smooth(k, 0.7) for k in range(30))])
    assert FeedState.RUNNING in said
    assert FeedState.EMPTY not in said
    assert said[-1] is FeedState.UNKNOWN


@pytest.mark.footage
@pytest.mark.parametrize(
    ("belt", "bare_below", "right"),
    [
        ("limestone", 0.03, FeedState.RUNNING),
        ("fines", 0.03, FeedState.UNKNOWN),
        ("fines", 0.004, FeedState.UNKNOWN),
    ],
)
def test_real_belts_that_run_are_not_said_to_be_empty_or_to_stand(
    belt: str, bare_below: float, right: FeedState
) -> None:
    pictures, polygon = filmed(belt)
    height, width = pictures[0].shape
    roi = make_roi(polygon, width, height, 320)
    watch = FeedWatch(FeedConfig(bare_below=bare_below), None, roi, (width, height))
    said = []
    for k, picture in enumerate(pictures):
        watch.step(roi.cut(picture), k / 24.0)
        said.append(watch.status.state)
    assert set(said[12:]) == {right}
    assert (watch.status.load is None) == (belt == "fines" and bare_below == 0.03)
    assert set(said) <= {right, FeedState.UNKNOWN}


RUNS = FeedStatus(FeedState.RUNNING, speed_mm_s=600.0)
STANDS = FeedStatus(FeedState.STOPPED, speed_mm_s=0.0)


@pytest.mark.parametrize(
    ("seen", "runs", "speed", "agrees"),
    [
        (RUNS, True, None, True),
        (RUNS, False, None, False),
        (STANDS, True, None, False),
        (STANDS, False, 0.0, True),
        (RUNS, None, 620.0, True),
        (RUNS, True, 900.0, False),
        (STANDS, None, 600.0, False),
        (FeedStatus(FeedState.EMPTY), True, 600.0, None),
        (FeedStatus(), True, None, None),
        (RUNS, None, None, None),
    ],
)
def test_the_plants_signal_is_compared_with_what_is_seen(
    seen: FeedStatus, runs: bool | None, speed: float | None, agrees: bool | None
) -> None:
    plant = PlantSignal(FeedConfig())
    plant.take(PlantFeed("drive", 100.0, runs, speed))
    assert plant.beside(seen, 1.0).agrees is agrees


def test_a_signal_that_differs_for_long_is_a_trouble_and_one_that_has_run_out_is_none() -> None:
    plant = PlantSignal(FeedConfig(signal_for_s=5.0))
    plant.take(PlantFeed("drive", 20.0, runs=True))
    for now_s in (1.0, 5.9):
        plant.beside(STANDS, now_s)
        assert not plant.differs(now_s)
    plant.beside(STANDS, 6.0)
    assert plant.differs(6.0)
    plant.beside(RUNS, 7.0)
    assert not plant.differs(7.0)
    assert plant.beside(RUNS, 20.0).plant is None
