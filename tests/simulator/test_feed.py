"""The simulated feed: its geometry, motion, truth and files."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.core.video_writer import Codec, VideoWriter
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.simulator.feed import FeedSimulator, Truth
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from tests.simulator.parts import parts

CALM = {"dust": 0.0, "noise": 0.0, "shake_px": 0.0, "light_drift": 0.0, "flicker": 0.0}
SMALL = {"width": 320, "height": 240}


def spec(**changes: object) -> FeedSpec:
    return FeedSpec.model_validate({**CALM, **SMALL, **changes})


def truths(feed: FeedSpec, seconds: float) -> list[tuple[Truth, ...]]:
    simulator = FeedSimulator(feed)
    return [simulator.render()[1] for _ in range(round(seconds * feed.fps))]


def tracks(frames: list[tuple[Truth, ...]]) -> dict[int, list[tuple[int, Truth]]]:
    found: dict[int, list[tuple[int, Truth]]] = {}
    for i, frame in enumerate(frames):
        for truth in frame:
            found.setdefault(truth.id, []).append((i, truth))
    return found


def centre(truth: Truth) -> tuple[float, float]:
    return truth.x + truth.w / 2, truth.y + truth.h / 2


# --- geometry ---


@pytest.mark.parametrize("changes", [{}, {"width": 1280, "height": 720, "belt_length_mm": 9000}])
def test_the_camera_is_a_pinhole_with_square_pixels(changes: dict[str, object]) -> None:
    g = Geometry.of(FeedSpec.model_validate(changes))
    inverse = np.linalg.inv(np.array([[g.focal_px, 0, g.cu], [0, g.focal_px, g.cv], [0, 0, 1]]))
    up = g.plane(1.0)[:, 2] - g.plane(0.0)[:, 2]
    axes = np.stack([inverse @ g.homography[:, 0], inverse @ g.homography[:, 1], inverse @ up])
    gram = axes @ axes.T
    np.testing.assert_allclose(gram / gram[0, 0], np.eye(3), atol=1e-9)
    assert up[1] < 0  # what is higher lies higher in the picture


@given(st.floats(-1200, 1200), st.floats(0, 6000))
def test_millimetres_and_pixels_invert_each_other(x: float, y: float) -> None:
    g = Geometry.of(FeedSpec())
    pixel = g.to_px((x, y))
    np.testing.assert_allclose(g.to_mm(pixel), (x, y), atol=1e-6)
    np.testing.assert_allclose(g.project(x, y)[:2], pixel, atol=1e-9)


def test_the_belt_lies_where_the_outline_says() -> None:
    simulator = FeedSimulator(spec())
    g = simulator.geometry
    np.testing.assert_allclose(g.to_px([(0, 0), (0, 6000)])[:, 1], [0, 0.77 * 240], atol=1e-9)
    np.testing.assert_allclose(np.ptp(g.to_px([(-1200, 6000), (1200, 6000)])[:, 0]), 1.04 * 240)
    outline = np.array(simulator.polygon) * (320, 240)
    np.testing.assert_allclose(outline[:3], g.to_px([(-1200, 0), (1200, 0), (1200, 6000)]), atol=0.05)
    assert outline[3, 1] == pytest.approx(g.rim_row, abs=0.05)


# --- motion of the belt ---


@given(st.integers(0, 50), st.floats(0.0, 300.0))
def test_speed_is_the_derivative_of_distance(seed: int, t: float) -> None:
    belt = BeltMotion(spec(seed=seed, stop_every_s=10, stop_duration_s=3))
    h = 1e-3
    slope = (belt.distance(t + h) - belt.distance(t)) / h
    assert slope == pytest.approx((belt.speed(t) + belt.speed(t + h)) / 2, abs=600 * h / 0.4 + 1e-6)
    assert belt.distance(belt.time_at(belt.distance(t) - 1.0, before=t + 1e-9)) == pytest.approx(
        belt.distance(t) - 1.0, abs=1e-5
    )


def test_the_belt_stands_as_long_as_stated() -> None:
    belt = BeltMotion(spec(stop_every_s=20, stop_duration_s=5))
    t = np.arange(0, 2000, 0.05)
    standing = np.array([belt.speed(x) for x in t]) == 0
    starts = np.count_nonzero(np.diff(standing.astype(int)) == 1)
    assert 50 <= starts <= 110  # one in 25 s or so
    assert standing.sum() * 0.05 / starts == pytest.approx(5 - 0.4, abs=0.1)
    assert belt.distance(2000) == pytest.approx(600 * (2000 - 5 * starts), abs=600 * 6)


def test_the_bed_of_ore_moves_with_the_belt() -> None:
    feed = spec(width=640, height=480, lumps_per_minute=0, medium_rocks_per_minute=0)
    simulator = FeedSimulator(feed)
    g, step, rows = simulator.geometry, 10.0, 200
    to_px = g.homography @ np.array([[step, 0, -900], [0, step, 3200], [0, 0, 1]])

    def rectified() -> np.ndarray:
        # -0.5: pixel centres lie at half-integers of the geometry.
        shift = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
        light = simulator.render()[0].astype(np.float32)
        flat = cv2.warpPerspective(
            light, shift @ to_px, (180, rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        return flat - cv2.GaussianBlur(flat, (0, 0), 15)  # the lamps stand still

    window = cv2.createHanningWindow((180, rows), cv2.CV_32F)
    before = rectified()
    for frames in (1, 2, 3):
        simulator.skip(frames - 1)
        after = rectified()
        (dx, dy), response = cv2.phaseCorrelate(before, after, window)
        assert dy * step == pytest.approx(600 * frames / 15, abs=3)
        assert dx * step == pytest.approx(0, abs=3)
        assert response > 0.2
        before = after


# --- truth ---


@pytest.fixture(scope="module")
def minute() -> list[tuple[Truth, ...]]:
    return truths(spec(fps=30, medium_rocks_per_minute=0), 60)


def test_boxes_ride_at_the_speed_of_the_belt(minute: list[tuple[Truth, ...]]) -> None:
    g = Geometry.of(spec())
    checked = 0
    for track in tracks(minute).values():
        whole = [(i, truth) for i, truth in track if truth.on_belt and truth.visibility == 1]
        if len(whole) < 60:
            continue
        (first, start), *rest = whole
        x0, y0 = g.to_mm(centre(start))
        for i, truth in rest:
            expected = g.to_px((x0, y0 + 600 * (i - first) / 30))
            np.testing.assert_allclose(centre(truth), expected, atol=0.05)
            assert start.seconds_to_lip - truth.seconds_to_lip == pytest.approx((i - first) / 30)
        checked += 1
    assert checked >= 4


def test_the_front_edge_decides_between_belt_and_fall(minute: list[tuple[Truth, ...]]) -> None:
    lip = Geometry.of(spec()).lip_row
    models = set()
    for truth in (truth for frame in minute for truth in frame):
        models.add(truth.model)
        assert truth.on_belt == (truth.model == "belt") == (truth.seconds_to_lip > 0)
        assert truth.on_belt == (truth.y + truth.h < lip)
    assert models == {"belt", "fall"}


def test_lumps_fall_with_gravity() -> None:
    feed = spec(fps=120, medium_rocks_per_minute=0, lumps_per_minute=20, gravity_mm_s2=5000.0)
    g = Geometry.of(feed)
    checked = 0
    for track in tracks(truths(feed, 20)).values():
        riding = [truth for _, truth in track if truth.on_belt]
        if not riding or riding[-1].visibility < 1:
            continue
        last = riding[-1]
        x, y = g.to_mm(centre(last))
        release_y = y + 600 * last.seconds_to_lip
        for truth in (truth for _, truth in track if not truth.on_belt and truth.visibility == 1):
            s = -truth.seconds_to_lip
            u, v, scale = g.project(x, release_y + 600 * s, -0.5 * 5000 * s * s)
            np.testing.assert_allclose(centre(truth), (u, v), atol=0.02)
            assert truth.w / last.w == pytest.approx(scale / g.project(x, y)[2], rel=1e-3)
            checked += 1
    assert checked > 20


def test_box_size_agrees_with_the_stated_size(minute: list[tuple[Truth, ...]]) -> None:
    g = Geometry.of(spec())
    sizes = set()
    for truth in (truth for frame in minute[::10] for truth in frame):
        sizes.add(truth.size_mm)
        assert 720 <= truth.size_mm <= 1200
        if not truth.on_belt or truth.visibility < 1:
            continue
        x, y = g.to_mm(centre(truth))
        left, right = g.to_px([(x - 500, y), (x + 500, y)])
        px_per_mm = (right[0] - left[0]) / 1000
        assert max(truth.w, truth.h) <= truth.size_mm * px_per_mm * 1.01
        assert np.hypot(truth.w, truth.h) >= truth.size_mm * px_per_mm * 0.99
    assert len(sizes) >= 4


def test_labels_start_half_inside_and_end_when_swallowed(minute: list[tuple[Truth, ...]]) -> None:
    whole_lives = [t for t in tracks(minute).values() if t[0][0] > 0 and t[-1][0] < len(minute) - 1]
    assert len(whole_lives) >= 4
    for track in whole_lives:
        assert [i for i, _ in track] == list(range(track[0][0], track[-1][0] + 1))
        first, last = track[0][1], track[-1][1]
        assert 0.5 <= first.visibility < 0.55
        assert first.y == 0
        assert 0.4 <= last.visibility < 0.75
        assert last.model == "fall"
    for truth in (truth for frame in minute for truth in frame):
        assert truth.x >= 0
        assert truth.y >= 0
        assert truth.x + truth.w <= 320
        assert truth.y + truth.h <= Geometry.of(spec()).rim_row + 1e-9


def test_boxes_lie_on_the_lumps_in_the_picture() -> None:
    with_lumps = FeedSimulator(spec(medium_rocks_per_minute=0, lumps_per_minute=4, fps=2))
    without = FeedSimulator(spec(medium_rocks_per_minute=0, lumps_per_minute=0, fps=2))
    frames = [with_lumps.render() for _ in range(160)]
    bare = [without.render()[0] for _ in range(160)]
    checked = 0
    for i in range(8, 152):
        picture, found = frames[i]
        # Alone: nothing labelled 4 s before or after, so nothing that enters or is swallowed either.
        alone = {truth.id for _, near in frames[i - 8 : i + 9] for truth in near} == {t.id for t in found}
        if not alone or len(found) != 1 or not found[0].on_belt or found[0].visibility < 1:
            continue
        difference = cv2.absdiff(picture, bare[i])
        x, y, w, h = found[0].x, found[0].y, found[0].w, found[0].h
        strip = 0.15
        for x0, y0, x1, y1 in (
            (x, y, x + strip * w, y + h),
            (x + w - strip * w, y, x + w, y + h),
            (x, y, x + w, y + strip * h),
            (x, y + h - strip * h, x + w, y + h),
        ):
            assert (difference[round(y0) : round(y1), round(x0) : round(x1)] > 15).mean() > 0.1
        # Beyond the box there is the shadow only, below and to the right of it.
        rows = slice(max(round(y - 0.05 * w), 0), round(y + h + 0.25 * w))
        difference[rows, max(round(x - 0.05 * w), 0) : round(x + w + 0.25 * w)] = 0
        assert difference.max() <= 8
        checked += 1
    assert checked > 10


def test_boxes_shake_with_the_picture() -> None:
    still, shaken = FeedSimulator(spec(fps=3)), FeedSimulator(spec(fps=3, shake_px=6))
    window = cv2.createHanningWindow((320, 240), cv2.CV_32F)
    checked = 0
    for _ in range(60):
        (a, before), (b, after) = still.render(), shaken.render()
        pairs = [
            (p, q)
            for p, q in zip(before, after, strict=False)
            if p.id == q.id and p.visibility == q.visibility
        ]
        if not pairs:
            continue
        (dx, dy), _ = cv2.phaseCorrelate(a.astype(np.float32), b.astype(np.float32), window)
        p, q = pairs[0]
        assert (q.x - p.x, q.y - p.y) == pytest.approx((dx, dy), abs=0.35)
        checked += 1
    assert checked > 10


def test_a_stop_of_the_belt_freezes_the_boxes() -> None:
    feed = spec(stop_every_s=6, stop_duration_s=3, fps=10, lumps_per_minute=20)
    g = Geometry.of(feed)
    frames = truths(feed, 40)
    steps: list[float | None] = []
    for before, after in pairwise(frames):
        old = {truth.id: truth for truth in before}
        moved = [
            g.to_mm(centre(truth))[1] - g.to_mm(centre(old[truth.id]))[1]
            for truth in after
            if truth.id in old and truth.on_belt and old[truth.id].visibility == truth.visibility == 1
        ]
        assert np.ptp(moved or [0.0]) < 1e-6  # one belt carries all
        steps.append(moved[0] if moved else None)
    known = [step for step in steps if step is not None]
    assert sum(abs(step) < 1e-6 for step in known) >= 20
    assert sum(abs(step - 60) < 1e-6 for step in known) >= 60
    assert all(-1e-6 <= step <= 60 + 1e-6 for step in known)


def test_the_same_motion_at_another_frame_rate() -> None:
    common = {"stop_every_s": 10, "shake_px": 1.0, "lumps_per_minute": 15}
    slow, fast = truths(spec(fps=10, **common), 25), truths(spec(fps=30, **common), 25)
    assert sum(map(len, slow)) > 100
    for i, frame in enumerate(slow):
        for a, b in zip(frame, fast[3 * i], strict=True):
            assert (a.id, a.model, a.size_mm) == (b.id, b.model, b.size_mm)
            assert (a.x, a.y, a.w, a.h) == pytest.approx((b.x, b.y, b.w, b.h), abs=1e-6)


def test_the_number_and_the_spacing_of_lumps() -> None:
    feed = spec(fps=0.5, width=160, height=120)
    g = Geometry.of(feed)
    frames = truths(feed, 900)
    ids = {truth.id for frame in frames for truth in frame}
    assert 95 <= len(ids) <= 145  # 8 a minute for 15 minutes
    for frame in frames:
        whole = sorted(g.to_mm(centre(t))[1] for t in frame if t.on_belt and t.visibility == 1)
        assert all(step >= 2.5 * 600 - 1 for step in np.diff(whole))


def test_the_number_of_lumps_in_a_minute(minute: list[tuple[Truth, ...]]) -> None:
    assert 4 <= len(tracks(minute)) <= 12


def test_no_lump_where_none_is_asked_for() -> None:
    feed = spec(lumps_per_minute=0, medium_rocks_per_minute=200)
    assert truths(spec(lumps_per_minute=0, fps=2, width=160, height=120), 120) == [()] * 240
    traffic = parts(feed).traffic
    seen = [rock for t in np.arange(0, 60, 0.5) for rock in traffic.at(float(t))]
    assert len({rock.start for rock in seen}) > 100
    assert all(rock.id == 0 and 180 <= rock.size_mm <= 420 for rock in seen)


def test_rocks_come_farthest_first_and_vanish() -> None:
    feed = spec(medium_rocks_per_minute=300, lumps_per_minute=20)
    traffic = parts(feed).traffic
    counts = []
    for t in np.arange(0, 600, 0.5):
        rocks = traffic.at(float(t))
        assert [rock.y for rock in rocks] == sorted(rock.y for rock in rocks)
        counts.append(len(rocks))
    assert max(counts[-200:]) < 2 * max(counts[:200])


# --- pictures ---


def test_the_same_spec_gives_the_same_bytes() -> None:
    feed = FeedSpec.model_validate({**SMALL, "seed": 3, "stop_every_s": 5})
    one, two, other = (
        FeedSimulator(feed),
        FeedSimulator(feed),
        FeedSimulator(feed.model_copy(update={"seed": 4})),
    )
    for _ in range(40):
        picture, found = one.render()
        again, found_again = two.render()
        assert picture.tobytes() == again.tobytes()
        assert found == found_again
        assert picture.tobytes() != other.render()[0].tobytes()


@pytest.mark.parametrize("skipped", [1, 7, 400])
def test_skipped_frames_change_nothing(skipped: int) -> None:
    feed = FeedSpec.model_validate({**SMALL, "fps": 10.0, "stop_every_s": 8})
    stepped, jumped = FeedSimulator(feed), FeedSimulator(feed)
    for _ in range(skipped):
        stepped.render()
    jumped.skip(skipped)
    assert jumped.time_s == stepped.time_s == skipped / 10
    (a, found), (b, found_again) = stepped.render(), jumped.render()
    assert a.tobytes() == b.tobytes()
    assert found == found_again


def test_gray_and_colour_pictures() -> None:
    gray, _ = FeedSimulator(spec()).render()
    colour, _ = FeedSimulator(spec(gray=False)).render()
    assert (gray.shape, colour.shape) == ((240, 320), (240, 320, 3))
    assert gray.dtype == colour.dtype == np.uint8
    blue, green, red = colour.reshape(-1, 3).mean(0)
    assert blue < green < red < 1.4 * blue
    assert np.abs(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(int) - gray).mean() < 2


def test_light_steps_when_stated() -> None:
    simulator = FeedSimulator(spec(light_step=0.5, light_step_at_s=1.0, fps=10))
    means = [simulator.render()[0].mean() for _ in range(20)]
    assert np.mean(means[10:]) / np.mean(means[:10]) == pytest.approx(0.5, abs=0.03)


def test_dust_hides_and_noise_speckles() -> None:
    detail = []
    for dust in (0.0, 0.5, 1.0):
        simulator = FeedSimulator(spec(dust=dust, fps=0.5))
        detail.append(np.mean([cv2.Laplacian(simulator.render()[0], cv2.CV_64F).std() for _ in range(20)]))
    assert detail[2] < 0.85 * detail[1] < 0.75 * detail[0]
    clear = FeedSimulator(spec()).render()[0]
    noisy = FeedSimulator(spec(noise=5.0)).render()[0]
    assert (noisy.astype(int) - clear).std() == pytest.approx(5.0, rel=0.1)


# --- spec ---


def test_a_query_states_a_spec() -> None:
    feed = FeedSpec.from_query("lumps_per_minute=6&dust=0.5&gray=false&seed=7", fps=25.0)
    assert (feed.lumps_per_minute, feed.dust, feed.gray, feed.seed, feed.fps) == (6.0, 0.5, False, 7, 25.0)
    assert FeedSpec.from_query("") == FeedSpec()
    assert FeedSpec.from_query("fps=30", fps=10.0).fps == 10.0


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("lumps=8", ("lumps: unknown key", "lumps_per_minute")),
        ("dust=2", ("dust:", "less than or equal to 1", "'2'")),
        ("dust=much", ("dust:", "number", "'much'")),
        ("dust=nan", ("dust:", "'nan'")),
        ("gray=perhaps", ("gray:", "boolean", "'perhaps'")),
        ("dust", ("expected key=value", "'dust'")),
        ("dust=0.1&dust=0.2", ("dust:", "more than once")),
        ("width=641", ("width:", "multiple of 2")),
        ("width=480", ("width (480)", "1.25", "height (480)")),
        ("smallest_lump=3", ("largest_lump must not be smaller",)),
        ("limit_mm=2000", ("largest_lump times limit_mm",)),
        ("belt_length_mm=3000", ("belt_length_mm must be at least twice",)),
    ],
)
def test_a_bad_query_is_refused_by_name(query: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        FeedSpec.from_query(query)
    message = str(caught.value)
    assert message.startswith("sim:feed: ")
    assert "\n" not in message
    for word in words:
        assert word in message


# --- files ---


def read(path: Path) -> tuple[list[np.ndarray], list[Fraction]]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = list(container.decode(stream))
        lumas = [
            np.frombuffer(bytes(f.planes[0]), np.uint8).reshape(-1, f.planes[0].line_size)[
                : f.height, : f.width
            ]
            for f in frames
        ]
        times = [f.pts * f.time_base for f in frames if f.pts is not None and f.time_base is not None]
        return [luma.copy() for luma in lumas], times


@pytest.mark.parametrize(("codec", "name"), [("h264", "a.mp4"), ("h265", "a.mp4"), ("mjpeg", "a.avi")])
@pytest.mark.parametrize("fps", [15.0, 29.97, 12.5])
def test_a_written_video_reads_back(tmp_path: Path, codec: Codec, name: str, fps: float) -> None:
    y, x = np.mgrid[:96, :128]
    pictures = [(2 * y + x // 4 + 3 * i).clip(0, 255).astype(np.uint8) for i in range(12)]
    with VideoWriter(tmp_path / name, 128, 96, fps, codec) as writer:
        for picture in pictures:
            writer.write(picture)
    lumas, times = read(tmp_path / name)
    assert times == [Fraction(i) / Fraction(str(fps)) for i in range(12)]
    for picture, luma in zip(pictures, lumas, strict=True):
        assert np.abs(picture.astype(int) - luma).mean() < 3


def test_colour_pictures_keep_their_luma_and_key_frames_come_with_the_gop(tmp_path: Path) -> None:
    picture = np.full((64, 96, 3), (40, 90, 200), np.uint8)
    with VideoWriter(tmp_path / "a.mp4", 96, 64, 10, gop=4) as writer:
        for _ in range(10):
            writer.write(picture)
    with av.open(str(tmp_path / "a.mp4")) as container:
        frames = list(container.decode(video=0))
    assert [i for i, frame in enumerate(frames) if frame.key_frame] == [0, 4, 8]
    luma = np.frombuffer(bytes(frames[0].planes[0]), np.uint8).reshape(-1, frames[0].planes[0].line_size)[
        :64, :96
    ]
    assert luma.mean() == pytest.approx(0.114 * 40 + 0.587 * 90 + 0.299 * 200, abs=4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((95, 64, 10), "must be even"),
        ((96, 63, 10), "must be even"),
        ((96, 64, 0), "fps"),
        ((96, 64, float("nan")), "fps"),
        ((96, 64, 10, "vp9"), "h264, h265, mjpeg"),
    ],
)
def test_a_writer_refuses_what_it_cannot_write(
    tmp_path: Path, arguments: tuple[object, ...], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        VideoWriter(tmp_path / "a.mp4", *arguments)  # type: ignore[arg-type]
    assert not (tmp_path / "a.mp4").exists()


@pytest.mark.parametrize(
    "picture", [np.zeros((64, 95), np.uint8), np.zeros((64, 96, 4), np.uint8), np.zeros((64, 96), np.float32)]
)
def test_a_writer_refuses_another_shape(tmp_path: Path, picture: np.ndarray) -> None:
    with (
        VideoWriter(tmp_path / "a.mp4", 96, 64, 10) as writer,
        pytest.raises(ValueError, match="expected uint8, 96x64"),
    ):
        writer.write(picture)


def test_write_video_writes_video_labels_and_spec(tmp_path: Path) -> None:
    feed = spec(fps=29.97, lumps_per_minute=30, belt_speed_mm_s=1200)
    progress: list[tuple[int, int]] = []
    paths = write_video(
        feed, 10, tmp_path / "new" / "out", lambda done, total: progress.append((done, total))
    )
    assert [p.name for p in (paths.video, paths.labels, paths.spec)] == ["video.mp4", "gt.txt", "spec.json"]
    frames = round(10 * 29.97)
    assert progress == [(i, frames) for i in range(1, frames + 1)]

    lumas, times = read(paths.video)
    assert times == [Fraction(i * 100, 2997) for i in range(frames)]

    rows = [line.split(",") for line in paths.labels.read_text().splitlines()]
    labels: dict[int, list[list[str]]] = {}
    for row in rows:
        assert len(row) == 10
        labels.setdefault(int(row[0]), []).append(row)
    assert {row[9] for row in rows} == {"belt", "fall"}
    simulator = FeedSimulator(feed)
    for i in range(frames):
        picture, found = simulator.render()
        assert np.abs(picture.astype(int) - lumas[i]).mean() < 6
        expected = sorted(found, key=lambda truth: truth.id)
        for truth, row in zip(expected, labels.get(i + 1, []), strict=True):
            assert int(row[1]) == truth.id
            assert [float(v) for v in row[2:6]] == pytest.approx(
                [truth.x, truth.y, truth.w, truth.h], abs=0.006
            )
            assert row[6:8] == ["1", "1"]
            assert float(row[8]) == pytest.approx(truth.visibility, abs=6e-4)
            assert row[9] == truth.model

    about = json.loads(paths.spec.read_text())
    assert FeedSpec.model_validate(about["spec"]) == feed
    np.testing.assert_allclose(about["homography"], simulator.homography)
    assert about["frames"] == frames
    assert about["lip_row"] == pytest.approx(0.77 * 240)
    assert about["polygon"] == [list(point) for point in simulator.polygon]
    assert set(about["lumps"]) == {row[1] for row in rows}
    assert all(720 <= lump["size_mm"] <= 1200 for lump in about["lumps"].values())


def test_write_video_refuses_an_empty_feed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="hold no frame"):
        write_video(spec(), 0.01, tmp_path)
