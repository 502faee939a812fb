"""Lens distortion: taken out of what is measured on the belt, and found from straight edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.lens import Lens, find_lens
from lumpwatch.models.plane import fit_plane, measure, side_of
from lumpwatch.service.cli import main
from tests.models.test_plane import ERRORS, GEOMETRY, LIP_MM, POINTS_MM, SIZE

WIDE = Lens(0.25, 0.08, SIZE)


@settings(max_examples=40)
@given(st.floats(-0.1, 1.0), st.floats(0.0, 0.5), st.floats(0, 640), st.floats(0, 480))
def test_seen_is_the_inverse_of_ideal(k1: float, k2: float, x: float, y: float) -> None:
    lens = Lens(k1, k2, SIZE)
    points = np.array([[x, y], [320.0, 240.0]])
    assert lens.seen(lens.ideal(points)) == pytest.approx(points, abs=1e-3)


def sphere(x: float, y: float, diameter: float, lens: Lens | None) -> np.ndarray:
    """Box of a sphere on the belt, as the lens shows it."""
    r = diameter / 2
    polar, around = np.meshgrid(np.linspace(0, np.pi, 40), np.linspace(0, 2 * np.pi, 60))
    there = [
        x + r * np.sin(polar) * np.cos(around),
        y + r * np.sin(polar) * np.sin(around),
        r + r * np.cos(polar),
    ]
    seen = np.array([GEOMETRY.project(*one)[:2] for one in np.stack(there, axis=-1).reshape(-1, 3)])
    seen = seen if lens is None else lens.seen(seen)
    low, high = seen.min(axis=0), seen.max(axis=0)
    return np.concatenate([(low + high) / 2, high - low])


@pytest.mark.parametrize(("x", "y"), [(0.0, 1500.0), (700.0, 4500.0), (-700.0, 2500.0)])
def test_size_speed_and_distance_do_not_depend_on_the_lens(x: float, y: float) -> None:
    points, lip = WIDE.seen(GEOMETRY.to_px(POINTS_MM)), WIDE.seen(GEOMETRY.to_px(LIP_MM))
    plane = fit_plane(points, POINTS_MM, 1.0, SIZE, lip, WIDE)
    assert plane.missed_px < 0.1
    here, there = (WIDE.seen(np.array([GEOMETRY.project(x, y + way, 350.0)[:2]]))[0] for way in (0.0, 6.0))
    found = measure(plane, sphere(x, y, 700.0, WIDE), (there - here) / 0.01, ERRORS)
    assert found is not None
    assert found.equivalent_mm.value == pytest.approx(700, rel=0.03)
    assert found.speed_m_s.value == pytest.approx(0.6, rel=0.03)
    assert found.distance_m.value == pytest.approx((6000 - y - 350) / 1000, abs=0.08)
    middle = sphere(x, y, 700.0, WIDE)[:2]
    box = sphere(x, y, 700.0, WIDE)
    assert side_of(plane, middle[None], 700.0)[0] == pytest.approx(np.sqrt(box[2] * box[3]), rel=0.05)


def test_without_it_a_wide_lens_falsifies_what_is_measured() -> None:
    points, lip = WIDE.seen(GEOMETRY.to_px(POINTS_MM)), WIDE.seen(GEOMETRY.to_px(LIP_MM))
    blind = fit_plane(points, POINTS_MM, 5.0, SIZE, lip)
    assert blind.missed_px > 1.0  # which `check` tells
    found = measure(blind, sphere(0.0, 4500.0, 700.0, WIDE), np.array([0.0, 60.0]), ERRORS)
    assert found is not None
    assert abs(found.equivalent_mm.value / 700 - 1) > 0.05


def edges(lens: Lens, noise: float = 0.0, count: int = 5) -> list[np.ndarray]:
    rng = np.random.default_rng(2)
    width, height = lens.size
    made = []
    for far in (0.06, 0.15, 0.85, 0.95):
        straight = np.column_stack([np.full(count, far * width), np.linspace(0.05, 0.95, count) * height])
        made.append(
            lens.seen(
                lens.ideal(straight[[0, -1]])[0]
                + np.linspace(0, 1, count)[:, None]
                * (lens.ideal(straight[[0, -1]])[1] - lens.ideal(straight[[0, -1]])[0])
            )
        )
    return [one + noise * rng.standard_normal(one.shape) for one in made]


def test_a_lens_is_found_from_straight_edges() -> None:
    true = Lens(0.3, 0.0, (1920, 1080))
    found, off_px = find_lens(edges(true), true.size)
    assert off_px < 0.1
    corners = np.array([[40.0, 40.0], [1880, 1000], [960, 30]])
    # Edges say nothing of the scale: what counts is that lines are straight.
    assert found.k1 == pytest.approx(0.3, abs=0.02)
    assert found.ideal(corners) == pytest.approx(true.ideal(corners), abs=25)
    rough, off_px = find_lens(edges(true, noise=1.0), true.size)
    assert rough.k1 == pytest.approx(0.3, abs=0.12)
    assert off_px < 2.0


def test_what_is_no_lens_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="folds over"):
        Lens(-0.5, 0.0, SIZE)
    with pytest.raises(ValueError, match="3 points"):
        find_lens([np.zeros((2, 2))], SIZE)
    zigzag = [
        "--edge",
        "80,40",
        "300,500",
        "75,1000",
        "--edge",
        "1800,30",
        "1500,520",
        "1795,700",
        "1400,1050",
    ]
    assert main(["lens", "1920x1080", *zigzag]) == 2
    told = capsys.readouterr().err
    assert "contradict" in told or "folds over" in told
    assert main(["lens", "1920", "--edge", "1,2", "3,4", "5,6"]) == 2
    assert main(["lens", "1920x1080", "--edge", "1,2", "3,4", "5000,6"]) == 2


def test_the_command_says_what_to_write_into_the_configuration(capsys: pytest.CaptureFixture[str]) -> None:
    true = Lens(0.3, 0.0, (1920, 1080))
    arguments = ["lens", "1920x1080"]
    for edge in edges(true):
        arguments += ["--edge", *(f"{x:.1f},{y:.1f}" for x, y in edge)]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert float(out.partition("k1: ")[2].partition(",")[0]) == pytest.approx(0.3, abs=0.01)
    assert "px as they are" in out
