"""The feeds of real pixels and their judge: on small pictures made here, and on the real ones where they are."""

from __future__ import annotations

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.state import H, W, X, Y
from lumpwatch.service.config import parse_config
from lumpwatch.service.detection import make_region
from lumpwatch.service.training.model_builder.sites import site_scenes
from lumpwatch.service.training.model_builder.split import part_of
from tests.footage import footage_folder
from tests.reproduction.real import ore, page, runner, suite
from tests.reproduction.real.belts import Load, composite, quarry
from tests.reproduction.real.cctv import BELTS, reel
from tests.reproduction.real.feeds import sites
from tests.reproduction.real.judge import Labels, Lump, Said, Verdict, judge, judge_folder, read_labels
from tests.reproduction.real.ore import SIDE, STEP, Piece, join, pieces, place_of
from tests.reproduction.real.peers import watch_peer
from tests.reproduction.real.render import Air, Scene, frames, length_of, write
from tests.reproduction.real.runner import Outcome
from tests.reproduction.real.stones import cutout, lay, stones
from tests.reproduction.real.strip import Body, Quilt, Strip, quilt
from tests.reproduction.real.view import View, project

POLYGON = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.9], [0.0, 0.9]]
SIZE, FPS = (100, 100), 10.0


# The judge: a lump of 20 x 20 rides down the middle, a pixel and a half a frame


def riding(first: int, last: int, lump: int = 1) -> dict[int, list[tuple[int, NDArray[np.float64]]]]:
    return {k: [(lump, np.array([40.0, -5 + 1.5 * (k - first), 20, 20]))] for k in range(first, last)}


def said(length: int, alarms: range, labels: dict[int, list[tuple[int, NDArray[np.float64]]]]) -> list[Said]:
    """The boxes of the labels are shown; the alarm stands for a while."""
    nothing = np.empty((0, 4))
    return [
        Said(k, k in alarms, np.array([box for _, box in labels[k]]) if k in labels else nothing)
        for k in range(1, length + 1)
    ]


def verdict(shown: list[Said], labels: Labels, unclear: Labels | None = None) -> Verdict:
    return judge(shown, labels, unclear or {}, POLYGON, SIZE, FPS)


def test_a_lump_announced_a_second_before_it_leaves_counts() -> None:
    """Its middle is at -5 + 1.5 n + 10 and leaves the region at 90: in frame 10 + 56, at 6.5 s."""
    labels = riding(10, 74)
    found = verdict(said(100, range(40, 70), labels), labels)
    (lump,) = found.lumps
    assert lump.leaves_s == pytest.approx(6.5)
    assert lump.warned_s == pytest.approx(2.6)
    assert lump.announced
    assert (found.announced, found.alarms, found.false_alarms) == (1, 1, 0)


@pytest.mark.parametrize(("raised", "in_time"), [(56, True), (57, False)])
def test_an_alarm_less_than_a_second_before_comes_too_late(raised: int, in_time: bool) -> None:
    labels = riding(10, 74)
    found = verdict(said(100, range(raised, 80), labels), labels)
    assert found.lumps[0].boxed
    assert found.lumps[0].announced is in_time


def test_an_alarm_with_its_box_elsewhere_announces_nothing_and_is_false() -> None:
    labels = riding(10, 74)
    shown = [replace(one, boxes=np.add(one.boxes, (35, 0, 0, 0))) for one in said(100, range(20, 60), labels)]
    found = verdict(shown, labels)
    assert (found.announced, found.false_alarms) == (0, 1)
    assert not found.lumps[0].boxed
    assert found.stray == 1.0


def test_an_alarm_on_what_may_be_taken_for_a_lump_counts_neither_way() -> None:
    rock = riding(10, 74, 7)
    found = verdict(said(100, range(20, 60), rock), {}, rock)
    assert (found.alarms, found.false_alarms, found.unclear_alarms) == (1, 0, 1)
    assert found.lumps == ()


def test_lumps_that_the_video_does_not_show_long_enough_do_not_count() -> None:
    """One is about to leave when the video begins, one has not left when it ends."""
    early, late = riding(-50, 15, 1), riding(60, 101, 2)
    labels = {k: early.get(k, []) + late.get(k, []) for k in range(1, 101) if k in early or k in late}
    assert verdict(said(100, range(0), labels), labels).lumps == ()


def test_alarms_without_any_lump_are_false_and_counted_by_raise() -> None:
    found = verdict(said(100, range(20, 40), {})[:50] + said(100, range(60, 70), {})[50:], {})
    assert (found.alarms, found.false_alarms) == (2, 2)
    assert found.standing == pytest.approx(0.3)


# Pictures of ore


def test_crops_lie_on_the_grid_of_their_frame() -> None:
    """Numbers run up a column: found by comparing the crops' borders."""
    assert place_of("images0090.png") == ore.Place(True, 4, 2, 2)
    assert place_of("images0091.png").row == 1
    assert place_of("images0093.png").column == 3
    with pytest.raises(ValueError, match="not a picture"):
        place_of("photo.png")


def test_splits_are_by_frame() -> None:
    assert part_of("images0000.png") == part_of("images0083.png") == "train"
    assert part_of("images0084.png") == part_of("images0104.png") == "dev"
    assert part_of("images0105.png") == part_of("images0149.png") == "test"
    assert part_of("images0127.png") == "train"  # frame 6
    assert Counter(part_of(f"image{n:02d}.png") for n in range(60)) == {"train": 36, "dev": 12, "test": 12}


def crop(name: str, pixels: ore.Image, *rocks: NDArray[np.float64]) -> ore._Crop:
    outlined = tuple(
        ore.Rock(rock, bool(rock.min() > 2 and rock.max() < SIDE - 3), ore.long_side(rock)) for rock in rocks
    )
    return ore._Crop(name, place_of(name), pixels, outlined, ())


def square(x: float, y: float, side: float = 30.0) -> NDArray[np.float64]:
    return np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]])


def test_a_rock_that_two_crops_cut_is_whole_when_they_are_joined() -> None:
    """In the frame it reaches from 190 to 270; the left crop ends at 250, the right one begins at 200."""
    frame = np.full((SIDE, SIDE + STEP, 3), 120, np.uint8)
    left = crop("images0090.png", frame[:, :SIDE], np.array([[190.0, 50], [249, 50], [249, 90], [190, 90]]))
    right = crop(
        "images0093.png",
        frame[:, STEP:],
        np.array([[0.0, 50], [70, 50], [70, 90], [0, 90]]),
        square(150, 150),
    )
    piece = join("frame", [left, right])
    assert piece.pixels.shape == frame.shape
    rocks = sorted(piece.rocks, key=lambda rock: -rock.length)
    assert [rock.whole for rock in rocks] == [True, True]
    assert rocks[0].length == pytest.approx(80, abs=1)
    assert piece.ore.all()


def test_a_rock_that_the_frame_cuts_is_not_whole() -> None:
    pixels = np.full((SIDE, SIDE, 3), 120, np.uint8)
    (rock,) = join("frame", [crop("images0090.png", pixels, square(0, 50))]).rocks
    assert not rock.whole


def made_piece(seed: int = 1, side: int = 400, count: int = 40) -> Piece:
    """Grey squares on brown noise."""
    rng = np.random.default_rng(seed)
    pixels = np.clip(rng.normal(110, 12, (side, side, 3)), 0, 255).astype(np.uint8)
    rocks: list[ore.Rock] = []
    for _ in range(count):
        length = float(rng.uniform(20, 60))
        x, y = (float(at) for at in rng.uniform(-10, side - 30, 2))
        corners = square(x, y, length)
        if any(
            np.all(np.abs(corners.mean(0) - r.corners.mean(0)) < (length + r.length) / 2 + 2) for r in rocks
        ):
            continue
        cv2.fillPoly(pixels, [ore.rounded(corners)], (200, 200, 200))
        inside = bool(corners.min() > 2 and corners.max() < side - 3)
        rocks.append(
            ore.Rock(np.clip(corners, 0, side - 1), inside, ore.long_side(np.clip(corners, 0, side - 1)))
        )
    boxes = np.array([[*rock.corners.min(0), *rock.corners.max(0)] for rock in rocks])
    return Piece("made", pixels, np.ones((side, side), bool), tuple(rocks), boxes)


# Strips


PLAN = Quilt(200, 600, 130, (0.9, 1.3), large=48.0, unclear=40.0, lumps=8)


def test_a_strip_is_as_large_as_asked_and_the_same_for_a_seed() -> None:
    one, other = (quilt(np.random.default_rng(3), [made_piece()], PLAN) for _ in range(2))
    assert one.pixels.shape == (600, 200, 3)
    np.testing.assert_array_equal(one.pixels, other.pixels)
    assert len(one.bodies) == len(other.bodies)


def test_outlines_lie_on_the_rocks_of_the_strip() -> None:
    """The made rocks are the only bright things: inside whole ones all is bright."""
    strip = quilt(np.random.default_rng(3), [made_piece()], PLAN)
    bright = cv2.GaussianBlur(strip.pixels[..., 0], (0, 0), 1.5) > 150
    whole = [body for body in strip.bodies if not body.cut]
    assert len(whole) >= 4
    for body in whole:
        inside = np.zeros(bright.shape, np.uint8)
        cv2.fillPoly(inside, [ore.rounded(body.corners)], (1,))
        well_inside = cv2.erode(inside, np.ones((7, 7), np.uint8))
        assert bright[well_inside > 0].mean() > 0.9


def test_a_strip_without_lumps_has_none() -> None:
    plan = replace(PLAN, large=45.0, unclear=36.0, largest=36.0, lumps=0.0, scale=(0.6, 0.7), window=80)
    strip = quilt(np.random.default_rng(3), [made_piece(count=14)], plan)
    assert not [body for body in strip.bodies if body.size >= 45.0]


def test_pictures_too_small_for_a_window_give_smaller_windows() -> None:
    strip = quilt(np.random.default_rng(3), [made_piece(side=150, count=5)], replace(PLAN, window=300))
    assert strip.pixels.shape == (600, 200, 3)


# Stones


def test_a_cutout_has_the_asked_length_and_its_outline_around_it() -> None:
    stone = max(stones([made_piece()]), key=lambda one: one.length)
    cut = cutout(stone, 50.0, 0.4, True)
    assert ore.long_side(cut.corners) == pytest.approx(50.0)
    inside = np.zeros(cut.alpha.shape, np.uint8)
    cv2.fillPoly(inside, [ore.rounded(cut.corners)], (1,))
    assert cut.alpha[cv2.erode(inside, np.ones((7, 7), np.uint8)) > 0].min() > 0.95
    assert cut.alpha[cv2.dilate(inside, np.ones((7, 7), np.uint8)) == 0].max() < 0.05
    assert cut.pixels[cv2.erode(inside, np.ones((9, 9), np.uint8)) > 0].min() > 150


def test_a_stone_is_laid_with_a_shadow_and_may_reach_over_the_edge() -> None:
    stone = stones([made_piece()])[0]
    cut = cutout(stone, 40.0, 0.0, False)
    canvas = np.full((60, 60, 3), 120, np.uint8)
    lay(canvas, cut, (-20, 10), 0.5, 4.0)
    assert canvas[:, 45:].min() == 120
    assert canvas.min() < 110
    assert canvas.max() > 150


@pytest.mark.parametrize("make", [composite, quarry])
def test_laid_belts_have_the_lumps_that_were_asked_for(make) -> None:  # type: ignore[no-untyped-def]
    load = Load(200, 900, 60.0, lumps=6, medium=20, least=0.3)
    strip = make(np.random.default_rng(5), [made_piece()], load)
    assert strip.pixels.shape == (900, 200, 3)
    assert 4 <= len([body for body in strip.bodies if body.size >= 60.0]) <= 6
    bare = make(np.random.default_rng(5), [made_piece()], replace(load, lumps=0))
    assert all(body.size < 60.0 for body in bare.bodies)


# The camera


def test_a_belt_seen_aslant_is_narrower_far_away_and_as_wide_as_asked_near() -> None:
    view = View(320, 240, 300, near=0.8, tilt_deg=40.0)
    edges = np.array(
        [[0.0, view.along(1.0)], [300.0, view.along(1.0)], [0.0, view.along(0.0)], [300.0, view.along(0.0)]]
    )
    seen = project(view.matrix(), edges)
    assert seen[1, 0] - seen[0, 0] == pytest.approx(0.8 * 320, rel=0.01)
    assert seen[3, 0] - seen[2, 0] < 0.75 * (seen[1, 0] - seen[0, 0])


@pytest.mark.parametrize(("tilt", "yaw", "roll"), [(25.0, 0.0, 0.0), (45.0, 5.0, 2.0)])
def test_the_product_takes_the_calibration_and_measures_the_belt_with_it(
    tilt: float, yaw: float, roll: float
) -> None:
    from lumpwatch.models.plane import fit_plane

    view = View(640, 480, 400, tilt_deg=tilt, yaw_deg=yaw, roll_deg=roll)
    told = view.calibration(5.0, 600.0)
    pixels = np.array(told["points"]) * (640, 480)
    plane = fit_plane(
        pixels, np.array(told["points_mm"]), 2.0, (640, 480), np.array(told["lip"]) * (640, 480)
    )
    assert float(plane.cameras.focal[0]) == pytest.approx(view.focal, rel=0.1)


# A scene as video


def small_scene(seconds: float = 4.0, crossing_s: float = 2.0, **air: object) -> Scene:
    view = View(160, 120, 120, tilt_deg=30.0)
    length = length_of(view, crossing_s, seconds)
    pixels = np.clip(np.random.default_rng(0).normal(100, 10, (length, 120, 3)), 0, 255).astype(np.uint8)
    bodies = []
    for k, y in enumerate(range(60, length - 60, 90)):
        corners = square(30 + 20 * (k % 3), y, 36.0 if k % 2 else 31.0)
        cv2.fillPoly(pixels, [ore.rounded(corners)], (210, 210, 210))
        bodies.append(Body(corners, ore.long_side(corners)))
    calm = Air(**{"noise": 1.0, "shake_px": 0.0, "flicker": 0.0, "blur": 0.0, **air})  # type: ignore[arg-type]
    around = np.full((120, 160, 3), 40, np.uint8)
    return Scene(view, Strip(pixels, tuple(bodies)), 34.0, crossing_s, seconds, 10.0, calm, around, 1)


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("away", [False, True])
def test_boxes_lie_on_the_bodies_and_move_with_the_belt(grey: bool, away: bool) -> None:
    scene = replace(small_scene(grey=grey), away=away)
    rows: dict[int, list[float]] = {}
    for picture, bodies in frames(scene):
        luma = picture if picture.ndim == 2 else picture[..., 0]
        for one in bodies:
            if one.visibility > 0.99 and one.w > 8:
                x, y, w, h = (round(v) for v in (one.x, one.y, one.w, one.h))
                assert luma[y + 3 : y + h - 3, x + 3 : x + w - 3].mean() > 150
                rows.setdefault(one.id, []).append(one.y)
    assert len(rows) > 2
    for ys in rows.values():
        steps = np.diff(ys)
        assert (steps < 0).all() if away else (steps > 0).all()


def test_a_scene_is_written_whole_and_the_same_again(tmp_path: Path) -> None:
    scene = small_scene(dust=0.3, shadow=0.3, shake_px=0.5)
    site: dict[str, object] = {"cameras": [{"rois": [{"polygon": scene.view.polygon()}]}]}
    for name in "ab":
        write(scene, tmp_path / name, site)
    for file in ("video.mp4", "gt.txt", "unclear.txt", "about.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    lumps, unclear = (read_labels(tmp_path / "a" / name) for name in ("gt.txt", "unclear.txt"))
    assert lumps
    assert unclear
    ids = {lump for boxes in lumps.values() for lump, _ in boxes}
    assert ids.isdisjoint(one for boxes in unclear.values() for one, _ in boxes)
    about = json.loads((tmp_path / "a" / "about.json").read_text())
    assert about["lumps"] == len(ids)


def test_minutes_of_a_site_teach_the_score_picture_by_picture(tmp_path: Path) -> None:
    scene = small_scene()
    roi = {"id": "apron", "polygon": scene.view.polygon()}
    camera = {"id": "feed", "source": {"url": "video.mp4"}, "rois": [roi]}
    site: dict[str, object] = {"site": "made", "store": {"path": "var"}, "cameras": [camera]}
    for role in ("train", "watch"):
        write(scene, tmp_path / "made-1" / role, site)
    scenes = list(site_scenes(tmp_path, every=4))
    assert len(scenes) == 2 * 40 // 4
    region = make_region(parse_config(json.dumps(site)).cameras[0].rois[0], 160, 120)
    lumps, unclear = (read_labels(tmp_path / "made-1" / "train" / name) for name in ("gt.txt", "unclear.txt"))
    for number, ((view,), _) in enumerate(scenes[:10]):
        frame = 4 * (number + 1)
        for states, boxes in ((view.objects, lumps), (view.doubtful, unclear)):
            wanted = [box for _, box in boxes.get(frame, [])]
            found = region.to_frame(states[:, [X, Y, W, H]])
            assert found == pytest.approx(np.array(wanted).reshape(-1, 4), abs=0.02)
    drawn = [births.draw(200, np.random.default_rng(0))[0] for _, births in scenes[:3]]
    # The first picture as of a region that nothing is known of, the next two with the sizes of the lumps.
    mean = [float(np.log(states[:, W]).mean()) for states in drawn]
    assert mean[1] == mean[2] != mean[0]


# The runner and the peers


def small_site(folder: Path) -> Path:
    scene = small_scene(8.0, crossing_s=4.0)
    site: dict[str, object] = {"cameras": [{"rois": [{"polygon": scene.view.polygon()}]}]}
    for role in ("train", "watch"):
        write(scene, folder / "made-1" / role, site)
    bare = replace(scene, strip=Strip(np.full_like(scene.strip.pixels, 100), ()))
    write(bare, folder / "made-1" / "quiet", site)
    return folder / "made-1"


def test_a_threshold_finds_bright_lumps_and_is_judged(tmp_path: Path) -> None:
    site = small_site(tmp_path)
    watch_peer("contours", site, "watch", tmp_path / "out")
    found = judge_folder(tmp_path / "out", site / "watch")
    assert found.lumps
    assert found.seconds == 8.0


def test_the_runner_trains_replays_and_judges_by_the_command_alone(tmp_path: Path) -> None:
    """A stand-in for the command: it writes down how it is called, and finds nothing."""
    site = small_site(tmp_path)
    fake = tmp_path / "lumpwatch.py"
    fake.write_text(
        "import json, pathlib, sys\n"
        "arguments = sys.argv[1:]\n"
        "with open('calls', 'a') as file: file.write(' '.join(arguments) + chr(10))\n"
        "if arguments[0] == 'replay':\n"
        "    out = pathlib.Path(arguments[arguments.index('--out') + 1])\n"
        "    out.mkdir()\n"
        "    lines = [json.dumps({'frame': k, 'state': 'CLEAR', 'objects': []}) for k in range(1, 81)]\n"
        "    (out / 'states.jsonl').write_text(chr(10).join(lines) + chr(10))\n"
    )
    command = [sys.executable, str(fake)]
    outcome = runner.run_site(command, site, "trained", tmp_path / "work", ["--folds=0"])
    assert not outcome.problem
    assert outcome.watch is not None
    assert outcome.watch.announced == 0
    assert outcome.watch.lumps
    calls = (tmp_path / "work" / "made-1-trained" / "calls").read_text().splitlines()
    assert [call.split()[0] for call in calls] == ["train", "replay", "replay"]
    assert "--camera feed --roi apron --folds=0" in calls[0]
    untrained = runner.run_site(command, site, "untrained", tmp_path / "work")
    table = runner.table([outcome, untrained])
    assert f"| made-1 | trained | 0 of {len(outcome.watch.lumps)} |" in table
    assert "| **all** | untrained |" in table


def test_what_the_command_says_when_it_fails_is_in_the_table(tmp_path: Path) -> None:
    site = small_site(tmp_path)
    command = [sys.executable, "-c", "import sys; sys.exit('no such thing')"]
    outcome = runner.run_site(command, site, "untrained", tmp_path / "work")
    assert "no such thing" in runner.table([outcome])


# The real ones


@pytest.fixture(scope="module")
def belt_ore() -> Path:
    folder = footage_folder("belt-ore", "labels.json")
    if folder is None:
        pytest.skip("needs the pictures of belt-ore (../shared/data/belt-ore)")
    return folder


@pytest.mark.footage
def test_halves_of_a_split_share_no_crop_and_are_full_of_rocks(belt_ore: Path) -> None:
    for split in ("train", "dev", "test"):
        for half in (0, 1):
            found = pieces(belt_ore, split, half)
            assert sum(rock.whole for piece in found for rock in piece.rocks) > 40


@pytest.mark.footage
def test_neighbouring_crops_show_the_same_where_they_overlap(belt_ore: Path) -> None:
    """What the places of the crops were found from."""
    crops = {one.name: one for one in ore.load(belt_ore, "dev")}
    left, right = (crops[name].pixels for name in ("images0090.png", "images0093.png"))
    np.testing.assert_array_equal(left[:, STEP:], right[:, : SIDE - STEP])
    below, above = (crops[name].pixels for name in ("images0090.png", "images0091.png"))
    np.testing.assert_array_equal(below[: SIDE - STEP], above[STEP:])


@pytest.mark.footage
@pytest.mark.slow
def test_a_real_scene_has_lumps_and_its_quiet_minute_none(belt_ore: Path) -> None:
    from tests.reproduction.real.feeds import scene

    site = next(one for one in sites("train") if one.name == "scroll-100")
    busy, quiet = (scene(site, role, belt_ore, 5.0) for role in ("watch", "quiet"))
    assert any(body.size >= site.limit and not body.cut for body in busy.strip.bodies)
    assert not any(body.size >= site.limit for body in quiet.strip.bodies)


@pytest.mark.footage
@pytest.mark.slow
def test_the_limestone_moves_as_it_was_seen_to() -> None:
    """Steps of 12 and 6 pixels: the monitor shows some pictures between two."""
    folder = footage_folder("belt-cctv", *(belt.file for belt in BELTS.values()))
    if folder is None:
        pytest.skip("needs the belts of belt-cctv (../shared/data/belt-cctv)")
    steps = np.array(reel(folder, "limestone").steps)
    assert np.all((np.abs(steps - 12.3) < 1.2) | (np.abs(steps - 6.1) < 0.8))


# The page


def test_the_page_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LUMPWATCH_FOOTAGE", str(tmp_path))
    suite.main(["--out", str(tmp_path)])
    text = (tmp_path / "results" / "real.md").read_text()
    assert "Missing here" in text
    assert "belt-ore" in text


def test_the_page_holds_figures_of_every_way() -> None:
    nothing = Verdict(60.0, (), 0, 0, 0, 0.0, 0.0)
    lumps = tuple(Lump(k, 9.0, 2.0 if k else None, True, 40.0) for k in range(4))
    outcomes = [
        Outcome("scroll-1", way, replace(nothing, lumps=lumps), replace(nothing, false_alarms=2), 1.0, 1.0)
        for way in ("trained", "untrained")
    ]
    text = page.write(outcomes, sites("test"), "test", [])
    assert "| `scroll` | 3 of 4 | 3 of 4 |" in text
    assert "2 in 1 min" in text
    assert "from above" in text
