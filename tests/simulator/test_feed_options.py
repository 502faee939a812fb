"""Weather, light, camera and link of the simulated feed: each option does what it says."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.errors import ConfigError
from lumpwatch.service.simulator.events import Moments
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from tests.simulator.parts import parts

BASE = {
    "dust": 0.0, "noise": 0.0, "shake_px": 0.0, "light_drift": 0.0, "flicker": 0.0,
    "width": 320, "height": 240, "lumps_per_minute": 0.0, "medium_rocks_per_minute": 0.0, "fps": 4.0,
}  # fmt: skip
STYLES = ("a", "b")


def spec(**changes: object) -> FeedSpec:
    return FeedSpec.model_validate({**BASE, **changes})


def pictures(frames: int, **changes: object) -> np.ndarray:
    simulator = FeedSimulator(spec(**changes))
    return np.stack([simulator.render()[0] for _ in range(frames)]).astype(float)


def detail(picture: np.ndarray) -> float:
    return float(cv2.Laplacian(picture, cv2.CV_64F).std())


# --- motion ---


@given(st.integers(0, 50), st.floats(0.0, 200.0))
def test_a_changing_speed_is_the_derivative_of_distance(seed: int, t: float) -> None:
    belt = BeltMotion(spec(seed=seed, speed_change=0.5, speed_change_every_s=5, stop_every_s=12))
    h = 1e-4
    slope = (belt.distance(t + h) - belt.distance(t)) / h
    assert slope == pytest.approx((belt.speed(t) + belt.speed(t + h)) / 2, abs=600 * 2 * h / 0.4 + 1e-5)
    assert belt.distance(belt.time_at(belt.distance(t) - 1.0, before=t + 1e-9)) == pytest.approx(
        belt.distance(t) - 1.0, abs=1e-4
    )


def test_the_speed_changes_within_its_share() -> None:
    belt = BeltMotion(spec(speed_change=0.4, speed_change_every_s=5))
    speeds = np.array([belt.speed(t) for t in np.arange(0, 600, 0.25)]) / 600
    assert speeds.min() >= 0.6
    assert speeds.max() <= 1.4
    assert speeds.std() == pytest.approx(0.4 / np.sqrt(3), rel=0.2)
    assert np.abs(np.diff(speeds)).max() <= 0.8 * 0.25 + 1e-9  # within a second


def test_moments_come_as_often_as_stated_however_they_are_asked_for() -> None:
    one, other = Moments((5, 1), 6.0), Moments((5, 1), 6.0)
    times = np.arange(0, 3000, 0.5)
    seen = {round(t - s, 6) for t in times for s, _ in one.since(float(t), 1.0)}
    assert len(seen) == pytest.approx(500, rel=0.15)
    at_once = {round(3000 - s, 6) for s, _ in other.since(3000.0, 3000.0)}
    assert {moment for moment in at_once if moment < 2999.5} == seen


# --- air and water ---


@pytest.mark.parametrize("style", STYLES)
def test_bursts_of_dust_hide_the_belt_for_a_while(style: str) -> None:
    calm = pictures(160, style=style, dust=0.2)
    burst = pictures(160, style=style, dust=0.2, dust_burst=3.0, dust_burst_every_s=8.0)
    share = np.array([detail(b) / detail(a) for a, b in zip(calm, burst, strict=True)])
    assert share.min() < 0.4
    assert share.max() > 0.95


def test_steam_is_white() -> None:
    clear, steamy = pictures(20), pictures(20, steam=1.0)
    assert steamy.mean() > 1.5 * clear.mean()
    assert np.mean([detail(p) for p in steamy]) < 0.7 * np.mean([detail(p) for p in clear])


def test_rain_draws_bright_upright_streaks() -> None:
    clear, wet = pictures(6), pictures(6, rain=1.0)
    streaks = wet - clear
    assert streaks.min() >= -1
    assert 0.02 < (streaks > 15).mean() < 0.3
    along = np.mean([np.corrcoef(s[:-3].ravel(), s[3:].ravel())[0, 1] for s in streaks])
    across = np.mean([np.corrcoef(s[:, :-3].ravel(), s[:, 3:].ravel())[0, 1] for s in streaks])
    assert along > across + 0.2
    assert abs(np.corrcoef(streaks[0].ravel(), streaks[1].ravel())[0, 1]) < 0.2  # elsewhere in each frame


def test_snow_falls() -> None:
    clear, snowy = pictures(8, fps=30.0), pictures(8, fps=30.0, snow=1.0)
    flakes = snowy - clear
    assert 0.002 < (flakes > 40).mean() < 0.1
    window = cv2.createHanningWindow((320, 240), cv2.CV_64F)
    (_, dy), _ = cv2.phaseCorrelate(flakes[2], flakes[3], window)
    assert 0.2 * 240 / 30 < dy < 1.1 * 240 / 30


def test_drops_spoil_round_spots_and_leave_the_rest() -> None:
    changed = np.abs(pictures(4) - pictures(4, lens_drops=6)) > 2
    assert 0.002 < changed[0].mean() < 0.12
    labels, _, boxes, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(changed[0].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    )
    assert (np.asarray(boxes) > 0).size >= 2
    again = np.abs(pictures(200) - pictures(200, lens_drops=6)) > 2
    assert (again[0] != again[-1]).mean() > 0.002  # others after 50 s
    assert labels >= 3


# --- light ---


@pytest.mark.parametrize("style", STYLES)
def test_a_night_picture_is_dark_noisy_and_bright_in_the_middle(style: str) -> None:
    day, night = pictures(2, style=style), pictures(2, style=style, night=1.0)
    assert night.mean() < 0.6 * day.mean()
    corners = [
        night[0][y, x].mean() for y in (slice(20), slice(-20, None)) for x in (slice(20), slice(-20, None))
    ]
    assert max(corners) < 0.4 * night[0][95:135, 145:185].mean()
    bright = night[0].clip(40, 215) == night[0]  # not clipped
    clean = pictures(1, style=style, night=1.0)[0]
    made = parts(spec(style=style, night=1.0))
    still = made.scene.draw(0.0, ())
    first, second = (made.weather.apply(still.copy(), frame / 4.0, frame).astype(float) for frame in range(2))
    np.testing.assert_array_equal(first, clean)
    difference = (second - first)[bright]  # the noise alone moves
    assert difference.std() / np.sqrt(2) == pytest.approx(16, rel=0.15)


def test_an_infra_red_picture_has_no_colour() -> None:
    colour = pictures(1, gray=False, night=1.0)[0]
    assert np.ptp(colour, axis=-1).max() == 0
    assert np.ptp(pictures(1, gray=False, night=0.5)[0], axis=-1).max() > 0


def test_the_exposure_jumps_and_recovers() -> None:
    fixed = pictures(240)
    ratio = pictures(240, exposure_jump=2.0, exposure_every_s=12.0, exposure_recovery_s=1.0)
    level = np.log2(ratio.mean((1, 2)) / fixed.mean((1, 2)))
    steps = np.diff(level)
    assert steps.max() > 0.4  # up, clipped at white
    assert steps.min() < -0.6
    assert np.median(np.abs(level)) < 0.1
    fall = int(np.argmin(steps)) + 1
    assert level[fall + 4] == pytest.approx(level[fall] / np.e, abs=0.12)  # a second later


def test_shadows_sweep_across_and_sun_patches_brighten() -> None:
    plain, shaded = pictures(80), pictures(80, shadow_edges=0.6, shadow_every_s=6.0)
    ratio = shaded / np.maximum(plain, 1)
    assert np.median(ratio[plain > 30]) == pytest.approx(1, abs=0.02)
    darkest = np.array([np.percentile(r[p > 30], 2) for r, p in zip(ratio, plain, strict=True)])
    assert darkest.min() == pytest.approx(0.4, abs=0.05)
    shares = np.array([(r[p > 30] < 0.6).mean() for r, p in zip(ratio, plain, strict=True)])
    assert 0.2 < shares.max() < 0.9  # a band, not all
    assert (shares == 0).any()
    sunny = pictures(8, sun_patches=1.0)
    assert (sunny - plain[:8]).min() >= -1
    brighter = sunny / np.maximum(plain[:8], 1)
    assert 0.02 < (brighter[plain[:8] > 30] > 1.3).mean() < 0.6


# --- camera and link ---


@pytest.mark.parametrize("style", STYLES)
def test_a_knock_moves_picture_and_boxes_for_good(style: str) -> None:
    common = {"style": style, "lumps_per_minute": 20.0}
    shift = {"camera_shift_x_px": 7.0, "camera_shift_y_px": -5.0, "camera_shift_at_s": 6.0}
    still, knocked = FeedSimulator(spec(**common)), FeedSimulator(spec(**common, **shift))
    window, checked = cv2.createHanningWindow((320, 240), cv2.CV_64F), 0
    for i in range(60):
        (a, before), (b, after) = still.render(), knocked.render()
        if i < 24:
            assert a.tobytes() == b.tobytes()
            assert before == after
            continue
        moved, _ = cv2.phaseCorrelate(a.astype(float), b.astype(float), window)
        assert moved == pytest.approx((7, -5), abs=0.3)
        old = {truth.id: truth for truth in before if truth.visibility == 1 and truth.on_belt}
        for truth in after:
            if truth.id in old and truth.visibility == 1:
                assert (truth.x, truth.y) == pytest.approx((old[truth.id].x + 7, old[truth.id].y - 5))
                checked += 1
    assert checked > 10


def test_boxes_stay_in_the_picture_of_a_camera_that_was_knocked() -> None:
    for shift in (-40.0, 40.0):
        knocked = {"camera_shift_x_px": shift, "camera_shift_at_s": 0.0}
        simulator = FeedSimulator(spec(lumps_per_minute=40.0, width=160, height=128, **knocked))
        found = [truth for _ in range(60) for truth in simulator.render()[1]]
        assert min(min(truth.x, 160 - truth.x - truth.w) for truth in found) == pytest.approx(0, abs=1e-9)
        assert min(truth.w for truth in found) > 2


def test_strong_shake() -> None:
    weak, strong = (parts(spec(shake_px=shake)).weather for shake in (1.0, 20.0))
    times = np.arange(0, 10, 0.05)
    a, b = (np.array([w.shift(t) for t in times]) for w in (weak, strong))
    np.testing.assert_allclose(b, 20 * a)
    assert np.abs(b).max() > 10


@pytest.mark.parametrize("gray", [True, False])
def test_a_thin_link_costs_detail(gray: bool) -> None:
    options = {"gray": gray, "noise": 2.5, "fps": 5.0}
    clean = pictures(8, **options)
    arrived = [pictures(8, **options, h264_crf=crf) for crf in (20, 35, 48)]
    errors = [float(np.abs(shown - clean).mean()) for shown in arrived]
    assert errors == sorted(errors)
    assert errors[0] < 4
    assert errors[2] > 5
    np.testing.assert_array_equal(arrived[2], pictures(8, **options, h264_crf=48))


def test_a_picture_of_the_link_depends_on_nothing_before_its_key_frame() -> None:
    one, other = (FeedSimulator(spec(h264_crf=40, fps=8.0, noise=2.0)) for _ in range(2))
    shown = [one.render()[0] for _ in range(24)]
    other.skip(13)
    late = [other.render()[0] for _ in range(11)]
    assert late[0].tobytes() != shown[13].tobytes()  # a key frame of its own
    for a, b in zip(shown[16:], late[3:], strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_written_feed_is_coded_once_at_the_stated_quality(tmp_path: Path) -> None:
    fine = write_video(spec(noise=3.0), 4, tmp_path / "fine")
    coarse = write_video(spec(noise=3.0, h264_crf=45), 4, tmp_path / "coarse")
    assert coarse.video.stat().st_size < 0.2 * fine.video.stat().st_size
    assert '"h264_crf": 45' in coarse.spec.read_text()


ROUGH = {
    "rain": 0.5, "snow": 0.5, "steam": 0.3, "lens_drops": 4, "night": 0.5, "dust_burst": 1.0, "dust": 0.3,
    "sun_patches": 0.5, "shadow_edges": 0.5, "exposure_jump": 2.0, "shake_px": 3.0, "noise": 2.0,
    "h264_crf": 35, "camera_shift_at_s": 1.0, "camera_shift_x_px": 5.0, "lumps_per_minute": 20.0,
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("gray", [True, False])
def test_everything_at_once_is_deterministic(style: str, gray: bool) -> None:
    one, other = (FeedSimulator(spec(style=style, gray=gray, **ROUGH)) for _ in range(2))
    for _ in range(16):
        (a, found), (b, found_too) = one.render(), other.render()
        assert a.dtype == np.uint8
        assert a.shape == ((240, 320) if gray else (240, 320, 3))
        assert a.tobytes() == b.tobytes()
        assert found == found_too


@pytest.mark.parametrize("style", STYLES)
def test_colour_keeps_the_luma(style: str) -> None:
    common = {"style": style, "rain": 0.5, "dust": 0.4, "sun_patches": 0.5}
    gray, colour = pictures(2, **common), pictures(2, **common, gray=False)
    luma = colour @ (0.114, 0.587, 0.299)
    assert np.abs(luma - gray).mean() < 2
    blue, _, red = colour.reshape(-1, 3).mean(0)
    assert (blue < red) == (style == "a")


# --- spec ---


def test_a_query_states_the_options() -> None:
    query = "style=b&h264_crf=40&frozen_share=0.2&camera_shift_at_s=3&lens_drops=4&smallest_lump=0.7&night=1"
    feed = FeedSpec.from_query(query)
    assert (feed.style, feed.h264_crf, feed.camera_shift_at_s, feed.lens_drops) == ("b", 40, 3.0, 4)
    assert (feed.smallest_lump, feed.belt_width_mm) == (0.7, 1800.0)
    assert FeedSpec.model_validate(feed.model_dump(mode="json")) == feed


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("style=c", ("style:", "'a' or 'b'", "'c'")),
        ("h264_crf=60", ("h264_crf:", "less than or equal to 51")),
        ("lump_contrast=-1", ("lump_contrast:", "greater than or equal to 0")),
        ("lens_drops=2.5", ("lens_drops:", "integer")),
        ("exposure_jump=0.5", ("exposure_jump:", "greater than or equal to 1")),
        ("camera_shift_x_px=99", ("camera_shift_x_px:", "less than or equal to 40")),
        ("speed_change=1", ("speed_change:", "less than or equal to 0.8")),
        ("touching_share=1", ("touching_share:",)),
        ("night=dark", ("night:", "number", "'dark'")),
        ("frozen_share=0.6&slab_share=0.6", ("frozen_share, smooth_share and slab_share", "exceed 1")),
        ("style=b&largest_lump=3.5", ("largest_lump times limit_mm",)),
        ("smallest_lump=0.6", ("smallest_lump:", "greater than or equal to 0.7")),
        ("fog=1", ("fog: unknown key", "lens_drops")),
    ],
)
def test_a_bad_option_is_refused_by_name(query: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        FeedSpec.from_query(query)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
