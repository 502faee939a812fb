"""Lumps of the simulated feed: their kinds, company and ways, and that the truth is what is drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from lumpwatch.service.simulator.bodies import View, body, draw_body, silhouette, turned
from lumpwatch.service.simulator.feed import FeedSimulator, Truth
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.stock import Stock
from lumpwatch.service.simulator.traffic import Rock, Traffic
from tests.simulator.parts import parts

BASE = {
    "dust": 0.0, "noise": 0.0, "shake_px": 0.0, "light_drift": 0.0, "flicker": 0.0,
    "width": 320, "height": 240, "medium_rocks_per_minute": 0.0, "lumps_per_minute": 6.0, "fps": 2.0,
}  # fmt: skip
KINDS = ("frozen", "smooth", "slab")
STYLES = ("a", "b")


def spec(**changes: object) -> FeedSpec:
    return FeedSpec.model_validate({**BASE, **changes})


def stock(feed: FeedSpec) -> Stock:
    return parts(feed).stock


def traffic(feed: FeedSpec) -> Traffic:
    return parts(feed).traffic


def tracks(feed: FeedSpec, seconds: float) -> dict[int, list[Truth]]:
    simulator, found = FeedSimulator(feed), dict[int, list[Truth]]()
    for _ in range(round(seconds * feed.fps)):
        for truth in simulator.render()[1]:
            found.setdefault(truth.id, []).append(truth)
    return found


def lone_lumps(feed: FeedSpec, seconds: float = 60) -> list[tuple[np.ndarray, np.ndarray, Truth]]:
    """Pictures with and without a lump that lies whole and alone on the belt."""
    simulator = FeedSimulator(feed)
    bare = FeedSimulator(FeedSpec.model_validate({**feed.model_dump(), "lumps_per_minute": 0}))
    shown = [(*simulator.render(), bare.render()[0]) for _ in range(round(seconds * feed.fps))]
    found = []
    for i in range(4, len(shown) - 4):
        picture, truths, empty = shown[i]
        near = {t.id for _, others, _ in shown[i - 4 : i + 5] for t in others}
        if len(near) == len(truths) == 1 and truths[0].on_belt and truths[0].y > 1:
            found.append((picture, empty, truths[0]))
    return found


# --- bodies ---


@pytest.mark.parametrize("kind", ["rock", *KINDS])
def test_a_body_fills_its_box_and_no_more(kind: str) -> None:
    rng = np.random.default_rng(4)
    view = View(0.7, np.array([0.6, 0.0, 0.8]))
    solid = body(rng, kind)
    reach = np.sqrt(((solid.corners[:, None] - solid.corners[None]) ** 2).sum(-1))
    assert reach.max() == pytest.approx(1)
    for roll in (0.0, 0.5, 2.0):
        shape = draw_body(solid, turned(0.3, roll), view, 150, np.full((400, 400), 90, np.float32))
        mask = shape.levels[0][..., 1] > 0.5
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        assert len(rows) == pytest.approx(2 * shape.half_height * 150, abs=2)
        assert len(columns) == pytest.approx(2 * shape.half_width * 150, abs=2)
        assert rows[0] + rows[-1] + 1 == pytest.approx(len(mask), abs=2)  # around the middle
        assert mask.sum() / 150**2 == pytest.approx(cv2.contourArea(
            silhouette(solid, turned(0.3, roll), view)[0].astype(np.float32)), rel=0.06)  # fmt: skip


def test_a_ball_shows_its_lit_side_and_throws_its_shadow_away_from_the_light() -> None:
    light = np.array([0.6, 0.0, 0.8])
    shape = draw_body(body(np.random.default_rng(1), "smooth"), turned(0.0), View(math.pi / 4, light), 160)
    grey, mask, shadow = np.moveaxis(shape.levels[0], 2, 0)
    middle = mask.shape[1] // 2
    inside = mask > 0.99
    right, left = grey[:, middle:][inside[:, middle:]], grey[:, :middle][inside[:, :middle]]
    assert right.mean() > 1.3 * left.mean()
    assert shadow[:, :middle].sum() > 3 * shadow[:, middle:].sum()


def test_the_kinds_differ_as_they_should() -> None:
    feed = spec(frozen_share=0.3, smooth_share=0.3, slab_share=0.3)
    shapes = {kind: stock(feed).shapes(kind) for kind in KINDS}

    def tone(kind: str) -> float:
        sprites = [shape.levels[0] for shape in shapes[kind]]
        return float(np.mean([s[..., 0].sum() / s[..., 1].sum() for s in sprites]))

    def texture(kind: str) -> float:
        return float(np.mean([np.abs(cv2.Laplacian(s.levels[0][..., 0], cv2.CV_32F))[s.levels[0][..., 1] > 0.99]
                              .mean() for s in shapes[kind]]))  # fmt: skip

    def flat(kind: str) -> float:
        return float(np.mean([shape.half_height / shape.half_width for shape in shapes[kind]]))

    assert tone("frozen") < 0.75 * tone("smooth")
    assert texture("frozen") > 2 * texture("smooth")
    assert flat("slab") < 0.9 * flat("smooth")


@pytest.mark.parametrize("share", ["frozen_share", "smooth_share", "slab_share"])
def test_a_share_of_the_lumps_is_of_a_kind(share: str) -> None:
    made = stock(spec(**{share: 0.5}))
    rng = np.random.default_rng(3)
    kind = share.removesuffix("_share")
    drawn = [made.lump(rng, 0, buried=False) for _ in range(400)]
    of_kind = [any(shape is one for one in made.shapes(kind)) for shape in drawn]
    assert np.mean(of_kind) == pytest.approx(0.5, abs=0.1)


# --- truth ---


OPTIONS = ["frozen_share", "smooth_share", "slab_share", "buried_share", "roll_share", None]


def edges(coverage: np.ndarray) -> tuple[float, float]:
    """Where a profile of coverage passes one half, first and last, in pixels."""
    there = np.flatnonzero(coverage > 0.5)
    a, b = there[0], there[-1]
    first = a + 0.5 - (coverage[a] - 0.5) / (coverage[a] - coverage[a - 1])
    return first, b + 0.5 + (coverage[b] - 0.5) / (coverage[b] - coverage[b + 1])


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("option", OPTIONS)
def test_boxes_end_where_the_lump_does(style: str, option: str | None) -> None:
    """Each lump drawn alone, all white, on black: to a pixel and a bit, which its soft edge takes."""
    feed = spec(style=style, seed=1, lumps_per_minute=30.0, **({option: 1.0} if option else {}))
    simulator, checked = FeedSimulator(feed), 0
    made = parts(feed)
    scene, moving = made.scene, made.traffic
    for t in np.arange(0, 12, 0.5):
        for rock in moving.at(float(t)):
            truth = simulator.truth(rock, float(t))
            if truth is None or truth.y <= 1 or truth.y + truth.h >= simulator.geometry.rim_row - 2:
                continue
            masks = [level[..., 1] for level in rock.shape.levels]
            white = tuple(np.dstack((255 * m, m, 0 * m)).astype(np.float32) for m in masks)
            canvas = np.zeros((240, 320), np.uint8)
            scene.draw_rock(canvas, replace(rock, tone=1.0, shape=replace(rock.shape, levels=white)))
            drawn = (*edges(canvas.max(0) / 255), *edges(canvas.max(1) / 255))
            stated = (truth.x, truth.x + truth.w, truth.y, truth.y + truth.h)
            assert drawn == pytest.approx(stated, abs=1.4)
            checked += 1
    assert checked >= 20


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("option", OPTIONS)
def test_a_lump_changes_the_picture_in_its_box(style: str, option: str | None) -> None:
    lumps = lone_lumps(spec(style=style, seed=1, **({option: 1.0} if option else {})), 40)
    assert len(lumps) >= 4
    for picture, empty, t in lumps:
        difference = cv2.absdiff(picture, empty)
        rows, columns = slice(round(t.y), round(t.y + t.h)), slice(round(t.x), round(t.x + t.w))
        assert (difference[rows, columns] > 8).mean() > 0.4
        # Beyond the box there is at most its shadow: nothing is brighter than without it.
        brighter = np.clip(picture.astype(int) - empty, 0, None)
        brighter[max(rows.start - 3, 0) : rows.stop + 3, max(columns.start - 3, 0) : columns.stop + 3] = 0
        assert brighter.max() <= 8


@pytest.mark.parametrize("style", STYLES)
def test_sizes_are_those_asked_for_and_bound_the_box(style: str) -> None:
    feed = spec(style=style, smallest_lump=0.7, largest_lump=0.9, lumps_per_minute=20)
    simulator = FeedSimulator(feed)
    g = simulator.geometry
    sizes, ratios = set(), []
    for truth in (t for _ in range(100) for t in simulator.render()[1]):
        assert 0.7 * 600 <= truth.size_mm <= 0.9 * 600
        sizes.add(truth.size_mm)
        if truth.on_belt and truth.visibility == 1:
            _, y = g.to_mm((truth.x + truth.w / 2, truth.y + truth.h / 2))
            ratios.append(max(truth.w, truth.h) / (truth.size_mm * g.project(0, y)[2]))
    assert len(sizes) >= 8
    assert max(ratios) <= 1.01
    assert min(ratios) >= 0.7  # a body is not seen along its longest diameter always


def test_the_other_style_is_another_place() -> None:
    one, other = FeedSimulator(spec()), FeedSimulator(spec(style="b"))
    assert (other.spec.belt_width_mm, other.spec.belt_length_mm) == (1800, 3600)
    assert spec(style="b", belt_width_mm=1500.0).belt_width_mm == 1500
    assert math.degrees(other.geometry.elevation - one.geometry.elevation) > 10
    a, b = one.render()[0].astype(float), other.render()[0].astype(float)
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.6
    light = [FeedSimulator(spec(style="b", seed=s)).render()[0] for s in (1, 2)]
    assert np.abs(light[0].astype(int) - light[1]).mean() > 10


def test_in_the_other_style_the_ore_moves_with_the_belt_and_lumps_fall() -> None:
    feed = spec(style="b", fps=20.0, lumps_per_minute=20.0)
    g = FeedSimulator(feed).geometry
    whole = [t for t in tracks(feed, 20).values() if {x.model for x in t} == {"belt", "fall"}]
    assert len(whole) >= 2
    for track in whole:
        riding = [t for t in track if t.on_belt and t.visibility == 1]
        centres = [g.to_mm((t.x + t.w / 2, t.y + t.h / 2)) for t in riding]
        for before, after in pairwise(centres):
            np.testing.assert_allclose(after - before, (0, 600 / 20), atol=0.05)
        for truth in track:
            assert truth.on_belt == (truth.y + truth.h < g.lip_row)


# --- contrast, burial, rolling ---


@pytest.mark.parametrize("style", STYLES)
def test_lumps_fade_into_the_ore(style: str) -> None:
    """Brightness and texture inside the lump against those of the ore that lies there without it."""
    strength = []
    for contrast in (1.0, 0.4, 0.05):
        ratios = []
        for picture, empty, t in lone_lumps(spec(style=style, lump_contrast=contrast), 40):
            middle = (
                slice(round(t.y + 0.25 * t.h), round(t.y + 0.75 * t.h)),
                slice(round(t.x + 0.25 * t.w), round(t.x + 0.75 * t.w)),
            )
            lump, ore = picture[middle].astype(float), empty[middle].astype(float)
            ratios.append(abs(math.log(lump.mean() / ore.mean())) + abs(math.log(lump.std() / ore.std())))
        strength.append(np.mean(ratios))
    assert strength[1] < 0.7 * strength[0]
    assert strength[2] < 0.65 * strength[0]  # ore elsewhere differs as well


def test_faded_lumps_differ_less_from_a_bare_belt() -> None:
    changes = []
    for contrast in (1.0, 0.3):
        for picture, empty, t in lone_lumps(spec(style="b", lump_contrast=contrast), 30)[:1]:
            below = slice(round(t.y + t.h), round(t.y + 1.3 * t.h))
            changes.append(cv2.absdiff(picture, empty)[below].max())  # the shadow fades as well
    assert len(changes) == 2
    assert changes[1] < 0.6 * changes[0]


def test_buried_lumps_show_their_upper_part() -> None:
    feed = spec(buried_share=1.0)
    made = stock(feed)
    for whole, shape in zip(made.shapes("plain"), made.shapes("plain", buried=True), strict=True):
        assert 0.3 < shape.shown < 0.85
        assert 0.4 * whole.half_height < shape.half_height < 0.95 * whole.half_height
    for _, _, truth in lone_lumps(feed):
        assert 0.3 < truth.visibility < 0.85
        assert truth.size_mm >= 720


def test_rolling_lumps_turn_and_slip_on_the_belt() -> None:
    feed = spec(style="b", roll_share=1.0, roll_slip=0.2, fps=10.0, lumps_per_minute=20.0)
    g, seen = FeedSimulator(feed).geometry, 0
    directions = set()
    for track in tracks(feed, 40).values():
        riding = [t for t in track if t.on_belt and t.visibility == 1]
        if len(riding) < 20:
            continue
        seen += 1
        first, last = (g.to_mm((t.x + t.w / 2, t.y + t.h / 2))[1] for t in (riding[0], riding[-1]))
        slip = (last - first) / (len(riding) - 1) * 10 / 600 - 1
        assert 0.02 < abs(slip) < 0.25  # the middle of its box wobbles
        directions.add(slip > 0)
        aspects = [t.h / t.w for t in riding]
        assert np.ptp(aspects) > 0.01  # it shows another side
        assert all(abs(b - a) < 0.1 for a, b in pairwise(aspects))
        assert all(t.on_belt == (t.y + t.h < g.lip_row) for t in track)
        left = [t.seconds_to_lip for t in riding]
        np.testing.assert_allclose(np.diff(left), -0.1, atol=1e-6)
    assert seen >= 4
    assert directions == {True, False}


def test_a_rolling_lump_is_drawn_at_any_size() -> None:
    rolling = stock(spec(lump_contrast=0.5)).rolling(np.random.default_rng(1))
    small, large = rolling.shape(0.4, 3.0), rolling.shape(0.4, 3000.0)
    assert small.half_height == pytest.approx(large.half_height)
    assert small.half_height == pytest.approx(rolling.half_height(0.4))
    assert len(small.levels[0]) < len(large.levels[0]) < 400


# --- company ---


def rocks(feed: FeedSpec, seconds: float) -> dict[tuple[int, float], Rock]:
    moving = traffic(feed)
    return {(r.id, r.start): r for t in np.arange(0, seconds, 0.5) for r in moving.at(float(t))}


def test_near_limit_rocks_are_not_labelled() -> None:
    feed = spec(near_limit_rocks_per_minute=20.0, lumps_per_minute=0.0)
    sizes = [rock.size_mm / 600 for rock in rocks(feed, 240).values()]
    assert 50 <= len(sizes) <= 110
    assert min(sizes) >= 0.7
    assert max(sizes) <= 1.0
    assert np.ptp(sizes) > 0.25
    assert not tracks(feed, 20)


def test_touching_lumps_touch_and_are_not_more() -> None:
    common = {"lumps_per_minute": 12.0, "fps": 0.5}
    feed = spec(touching_share=0.5, **common)
    seconds = 900
    count = len({r.id for r in rocks(feed, seconds).values()})
    assert count == pytest.approx(len({r.id for r in rocks(spec(**common), seconds).values()}), rel=0.25)
    beside = 0
    lumps = sorted(rocks(feed, seconds).values(), key=lambda rock: rock.id)
    for one, other in pairwise(lumps):
        if other.start == one.start:
            gap = (
                abs(one.x - other.x)
                - one.shape.half_width * one.size_mm
                - other.shape.half_width * other.size_mm
            )
            assert abs(gap) < 0.05 * (one.size_mm + other.size_mm)
            beside += 1
    assert beside >= 0.1 * len(lumps)


def test_lumps_in_clusters_have_company() -> None:
    feed = spec(cluster_share=1.0)
    all_rocks = rocks(feed, 120).values()
    lumps = [rock for rock in all_rocks if rock.id]
    assert len(lumps) >= 6
    for lump in lumps:
        around = [r for r in all_rocks if not r.id and abs(r.start - lump.start) < 3000]
        assert len(around) >= 3
        assert all(180 <= r.size_mm <= 420 for r in around)
    assert all(rock.id for rock in rocks(spec(), 120).values())


@pytest.mark.parametrize("style", STYLES)
def test_hard_traffic_is_the_same_after_skipped_frames(style: str) -> None:
    feed = spec(
        style=style, gray=False, fps=10.0, lumps_per_minute=20.0, medium_rocks_per_minute=60.0,
        near_limit_rocks_per_minute=10.0, touching_share=0.3, cluster_share=0.5, roll_share=0.5,
        buried_share=0.3, frozen_share=0.3, slab_share=0.3, smooth_share=0.3, lump_contrast=0.7,
        speed_change=0.5, stop_every_s=8.0,
    )  # fmt: skip
    stepped, jumped = FeedSimulator(feed), FeedSimulator(feed)
    for _ in range(157):
        stepped.render()
    jumped.skip(157)
    (a, found), (b, found_too) = stepped.render(), jumped.render()
    assert a.tobytes() == b.tobytes()
    assert found == found_too
    assert found
