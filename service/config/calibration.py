"""Where the belt lies in the picture, and how large a lump may be."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.base import Positive, Strict, Unit

Corner = tuple[Unit, Unit]


class WidthConfig(Strict):
    """A belt of known width, seen at two rows: four corners of a rectangle of unknown length."""

    far: tuple[Corner, Corner]
    """Left and right edge of the belt where it is far away."""
    near: tuple[Corner, Corner]
    """Left and right edge where it is near."""
    width_mm: Positive
    """Width of the belt between them."""
    view_deg: Annotated[float, Field(gt=5.0, lt=170.0)]
    """The camera's horizontal angle of view, from its data sheet."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        spans = [(right[0] - left[0], right[1] - left[1]) for left, right in (self.far, self.near)]
        if spans[0][0] * spans[1][0] + spans[0][1] * spans[1][1] <= 0:
            raise ValueError("left and right are swapped at one of far and near")
        return self


class LensConfig(Strict):
    """How the lens bends the picture: a point at a share r of half the width from the middle lies (1 + k1 r^2 + k2 r^4)
    times as far from it for a camera without distortion. `lumpwatch lens` finds it from straight edges.
    """

    k1: Annotated[float, Field(ge=-0.5, le=2.0)] = 0.0
    """Positive for the barrel of a wide lens."""
    k2: Annotated[float, Field(ge=-0.5, le=2.0)] = 0.0
    """Matters for fisheyes only."""


class CalibrationConfig(Strict):
    """From the picture to millimetres; picture coordinates are relative, 0 to 1.

    Either some points whose place on the belt is known, or a known width at two rows.
    """

    points: Annotated[tuple[Corner, ...], Field(max_length=64)] = ()
    """Points of the belt in the picture, four at least."""
    points_mm: tuple[tuple[float, float], ...] = ()
    """Their places on the belt, in any right-angled coordinates."""
    width: WidthConfig | None = None
    """The other way: a known width at two rows."""
    lip: tuple[Corner, Corner]
    """Two points of the line at which lumps leave the belt."""
    lens: LensConfig | None = None
    """How the lens bends the picture; left out: it does not."""
    error_px: Positive = 2.0
    """Standard deviation of a point in the picture, pixels."""
    speed_m_s: Positive | None = None
    """Usual speed of the belt, give or take a quarter: tells how many frames a second it takes to find a lump, and when
    one that was just found reaches the lip. Left out: `sight` says the first, the second is `uncertain` at first."""
    limit_mm: Positive | None = None
    """Longest diameter that the crusher takes: the alarm is raised for what is larger; left out: for all lumps."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.width is None) == (not self.points):
            raise ValueError("give either points with points_mm, or width")
        if len(self.points) != len(self.points_mm):
            raise ValueError(f"{len(self.points)} points, but {len(self.points_mm)} points_mm")
        if self.points and len(self.points) < 4:
            raise ValueError(f"four points at least, not {len(self.points)}")
        if self.lip[0] == self.lip[1]:
            raise ValueError("the two points of the lip are the same")
        return self
