"""The belt seen by a camera: from boxes in the picture to millimetres on the belt, with their errors.

A few points of the belt whose place is known, in pixels and in millimetres, give the camera (`belt_camera`).
An object is taken for a sphere of
diameter D that lies on the belt; the ray through the middle of its box meets the sphere's centre D / 2
above the belt, and its silhouette covers the angle alpha with sin(alpha) = (D / 2) / distance:

    D / 2 = h sin(alpha) / (|d_z| + sin(alpha))

with h the camera's height over the belt and d the ray's direction.

Errors are propagated to first order: every result is computed again with each picture coordinate of
the calibration, and each component of the box, moved by its standard deviation; the squares of the
differences add up to the variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.belt_camera import (
    LARGEST_VIEW_DEG,
    SMALLEST_VIEW_DEG,
    Pose,
    best_poses,
    exact_pose,
    homography,
    misses,
    view_deg,
)
from lumpwatch.models.lens import Lens

Array = NDArray[np.float64]
_LEAST_POINTS = 4
TOLERANCE = 4.0
"""Times the stated error of a point that the best camera may miss the points by."""
_SURE_OF_FOCAL = 0.4  # between the largest and the smallest, in their logarithm
_STEP_S = 0.02
"""Time over which a velocity in the picture is followed on the belt."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Pinhole cameras (k of them: one for the calibration, one for each of its errors)."""

    focal: Array
    """px (k,)"""
    rotation: Array
    """Rows: the axes of the belt (along its x, its y, and up) in the camera's frame (k, 3, 3)."""
    centre: Array
    """The camera's place in belt coordinates, mm (k, 3)."""


@dataclass(frozen=True, slots=True)
class BeltPlane:
    """A calibrated belt; picture coordinates are pixels of the whole picture."""

    middle: tuple[float, float]
    """Principal point."""
    cameras: Camera
    """The estimate, then one for each picture coordinate of the calibration moved by its error."""
    lip: tuple[Array, Array]
    """A point of the lip for each camera, mm (k, 2), and the unit normal that points beyond it (k, 2)."""
    missed_px: float = 0.0
    """By how much the camera misses the points of the calibration, px (root mean square)."""
    view_deg: float = 0.0
    """The camera's horizontal angle of view."""
    lens: Lens | None = None
    """How the lens bends the picture; None: it does not."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A figure and its standard deviation."""

    value: float
    spread: float


@dataclass(frozen=True, slots=True)
class OnBelt:
    """What a box says about the object on the belt."""

    equivalent_mm: Measure
    """Diameter of the sphere that covers as much of the picture."""
    longest_mm: Measure
    """The same, times the longer over the mean side of the box."""
    speed_m_s: Measure
    distance_m: Measure
    """From the object's leading side to the lip, along the lip's normal; negative beyond it."""
    towards_m_s: Measure
    """The part of the speed that leads to the lip; negative away from it."""
    lip_s: Measure | None
    """Seconds until it gets there at this speed; None where it does not surely move towards the lip."""


def fit_plane(
    points_px: Array,
    points_mm: Array,
    error_px: float,
    size: tuple[int, int],
    lip_px: Array,
    lens: Lens | None = None,
) -> BeltPlane:
    """The plane from picture points (n, 2) and their places on the belt (n, 2), in a picture of `size` (w, h).

    `lip_px` (2, 2) are two points of the line behind which the belt ends; `lens`: how the picture is bent. Raises
    ValueError for fewer than four points, three or more on a line where four are needed, and points that the best
    camera misses by more than `TOLERANCE` times `error_px`.
    """
    points_px, points_mm = np.asarray(points_px, float), np.asarray(points_mm, float)
    lip_px = np.asarray(lip_px, float)
    if points_px.shape != points_mm.shape or points_px.ndim != 2 or points_px.shape[1] != 2:
        raise ValueError("calibration: as many picture points as belt points, two coordinates each")
    if len(points_px) < _LEAST_POINTS:
        raise ValueError(f"calibration: needs {_LEAST_POINTS} points at least, not {len(points_px)}")
    if not error_px > 0:
        raise ValueError("calibration: the error of a point must be positive")
    if lens is not None:
        points_px, lip_px = lens.ideal(points_px), lens.ideal(lip_px)
    middle = (size[0] / 2.0, size[1] / 2.0)
    cameras, missed_px = _cameras(points_px - middle, points_mm, error_px, size[0])
    view = view_deg(float(cameras.focal[0]), size[0])
    plane = BeltPlane(middle, cameras, (np.zeros((1, 2)), np.zeros((1, 2))), missed_px, view)
    k = len(cameras.focal)
    ends = [_meet(plane, np.tile(end, (k, 1)), np.arange(k), 0.0)[:, :2] for end in lip_px]
    along = ends[1] - ends[0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not np.all(length > 0):
        raise ValueError("calibration: the two points of the lip are the same")
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length
    # The belt lies on the near side of the lip: the normal points away from the calibration points.
    inwards = np.einsum("kc,kc->k", normal, points_mm.mean(axis=0) - ends[0])
    normal = np.where(inwards[:, None] > 0, -normal, normal)
    return replace(plane, lip=(ends[0], normal), lens=lens)


def _cameras(points_px: Array, points_mm: Array, error_px: float, width: float) -> tuple[Camera, float]:
    """The camera that saw the points, px from the principal point, and one for each of their errors.

    Second by how much it misses them. Raises ValueError.
    """
    moved = [points_px]
    for coordinate in range(points_px.size):
        other = points_px.copy()
        other.flat[coordinate] += error_px
        moved.append(other)
    inside = points_mm.mean(axis=0)
    poses = [exact_pose(homography(points_mm, one), inside) for one in moved]
    exact = [pose for pose in poses if pose is not None and _usual(pose, width)]
    if (
        len(exact) == len(moved)
        and _agree(exact)
        and misses(exact[0], points_mm, points_px) <= 2.0 * error_px
    ):
        return _stacked(exact), misses(exact[0], points_mm, points_px)
    (first,) = best_poses(points_mm, [points_px], error_px, width)
    missed = misses(first, points_mm, points_px)
    if missed > TOLERANCE * error_px:
        raise ValueError(
            f"calibration: the camera that fits best misses the points by {missed:.1f} px, more than {TOLERANCE:g} "
            f"times error_px ({error_px:g}); check their order and the belt's measures, or state a larger error_px"
        )
    # What the points miss by is what they are known to: with few points, more than the root mean square says.
    free = max(points_px.size - 6, 2)
    error = max(error_px, missed * np.sqrt(points_px.size / free))
    further = [points_px + (one - points_px) * (error / error_px) for one in moved]
    return _stacked(best_poses(points_mm, further, error_px, width)), missed


def _usual(pose: Pose, width: float) -> bool:
    return SMALLEST_VIEW_DEG < view_deg(pose.focal, width) < LARGEST_VIEW_DEG


def _agree(poses: Sequence[Pose]) -> bool:
    """Whether the points tell the focal length: from straight above they hardly do, and what is usual must help."""
    return float(np.ptp(np.log([pose.focal for pose in poses]))) < _SURE_OF_FOCAL


def _stacked(poses: Sequence[Pose]) -> Camera:
    focal = np.array([pose.focal for pose in poses])
    return Camera(focal, np.stack([p.rotation for p in poses]), np.stack([p.centre for p in poses]))


def measure(plane: BeltPlane, box: Array, velocity: Array, errors: Array) -> OnBelt | None:
    """What a box (x, y, w, h by its centre, px) with a velocity (px/s) says, None where it is not on the belt.

    `errors` (6,) are the standard deviations of x, y, w, h and the velocity along x and y.
    """
    if plane.lens is not None:
        box, velocity, errors = _straightened(plane.lens, box, velocity, errors)
    state = np.concatenate([box, velocity])
    k = len(plane.cameras.focal)
    states = np.tile(state, (k + len(errors), 1))
    states[k + np.arange(len(errors)), np.arange(len(errors))] += errors
    chosen = np.concatenate([np.arange(k), np.zeros(len(errors), np.intp)])
    if not np.all(states[:, 2:4] > 0):
        return None
    radius, ray_ok = _radius(plane, states, chosen)
    if not ray_ok:
        return None
    here = _meet(plane, states[:, :2], chosen, radius)[:, :2]
    there = _meet(plane, states[:, :2] + _STEP_S * states[:, 4:], chosen, radius)[:, :2]
    speed = (there - here) / _STEP_S / 1000.0
    point, normal = plane.lip[0][chosen], plane.lip[1][chosen]
    distance = (np.einsum("kc,kc->k", point - here, normal) - radius) / 1000.0
    towards = np.einsum("kc,kc->k", speed, normal)
    longer = states[:, 2:4].max(axis=1) / np.sqrt(states[:, 2] * states[:, 3])
    return OnBelt(
        _measured(2.0 * radius),
        _measured(2.0 * radius * longer),
        _measured(np.linalg.norm(speed, axis=1)),
        _measured(distance),
        _measured(towards),
        _measured(distance / towards) if towards[0] > 2.0 * _measured(towards).spread else None,
    )


def _straightened(lens: Lens, box: Array, velocity: Array, errors: Array) -> tuple[Array, Array, Array]:
    """As a pinhole would have seen them."""
    ends = lens.ideal(np.stack([box[:2], box[:2] + _STEP_S * velocity]))
    return lens.ideal_box(box), (ends[1] - ends[0]) / _STEP_S, errors * lens.magnified(box[None, :2])[0]


def side_of(plane: BeltPlane, points: Array, diameter_mm: float) -> Array:
    """Side (n,) of the square box in which a sphere on the belt is seen with its middle at points (n, 2), px.

    The reverse of `measure`'s equivalent diameter; NaN where no belt is seen or the sphere would not fit
    under the camera.
    """
    bent = 1.0 if plane.lens is None else plane.lens.magnified(points)
    points = points if plane.lens is None else plane.lens.ideal(points)
    direction, cosine = _rays(plane, points, np.zeros(len(points), np.intp))
    falls, radius = -direction[:, 2], 0.5 * diameter_mm
    room = plane.cameras.centre[0, 2] - radius
    sine = radius * falls / room if room > 0 else np.full(len(points), np.nan)
    sine = np.where(falls > 0, sine, np.nan)
    return 2.0 * sine * plane.cameras.focal[0] / cosine**1.5 / bent


def equivalent_mm(plane: BeltPlane, boxes: Array) -> Array:
    """Diameter (n,) of the sphere on the belt that covers as much of the picture as each box (n, 4) by its centre, px.

    NaN where no belt is seen, and for a box without area.
    """
    chosen = np.zeros(len(boxes), np.intp)
    radius, _ = _radius(plane, boxes, chosen)
    direction, _ = _rays(plane, boxes[:, :2], chosen)
    fit = (direction[:, 2] < -1e-6) & (boxes[:, 2:] > 0).all(axis=1)
    return np.where(fit, 2.0 * radius, np.nan)


def towards_lip(plane: BeltPlane, points: Array) -> tuple[Array, Array]:
    """Distance of the belt behind picture points (n, 2) to the lip (n,), mm, negative beyond it, and its slope.

    The slope (n, 2) is how much nearer to the lip a step of one px along x and along y leads, mm/px. NaN where no belt
    is seen.
    """
    chosen = np.zeros(len(points), np.intp)
    direction, _ = _rays(plane, points, chosen)
    normal = plane.lip[1][0]

    def left(at: Array) -> Array:
        return np.asarray((plane.lip[0][0] - _meet(plane, at, chosen, 0.0)[:, :2]) @ normal, float)

    here, half = left(points), 0.5
    slope = np.column_stack(
        [(left(points - step) - left(points + step)) for step in ((half, 0.0), (0.0, half))]
    )
    seen = direction[:, 2] < -1e-6
    return np.where(seen, here, np.nan), np.where(seen[:, None], slope, np.nan)


def ground_of(plane: BeltPlane, points: Array) -> Array:
    """How much of the belt one px shows at picture points (n, 2), mm2 (n,); 0 beyond the lip and off the belt."""
    chosen = np.zeros(len(points), np.intp)
    places = [
        _meet(plane, points + step, chosen, 0.0)[:, :2]
        for step in ((-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5))
    ]
    across, along = places[1] - places[0], places[3] - places[2]
    area = np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])
    left, _ = towards_lip(plane, points)
    return np.where(np.nan_to_num(left, nan=-1.0) > 0.0, area, 0.0)


def on_belt(plane: BeltPlane, points: Array) -> Array:
    """Places (n, 2) on the belt, mm, behind picture points (n, 2), px; NaN where no belt is seen."""
    points = points if plane.lens is None else plane.lens.ideal(points)
    chosen = np.zeros(len(points), np.intp)
    direction, _ = _rays(plane, points, chosen)
    return np.where(direction[:, 2:] < -1e-9, _meet(plane, points, chosen, 0.0)[:, :2], np.nan)


def to_picture(plane: BeltPlane, places: Array) -> Array:
    """Picture points (n, 2), px, of places on the belt (n, 2), mm; NaN where they lie behind the camera."""
    cameras = plane.cameras
    seen = (np.column_stack([places, np.zeros(len(places))]) - cameras.centre[0]) @ cameras.rotation[0]
    ahead = np.where(seen[:, 2:] > 1e-9, seen[:, 2:], np.nan)
    points = cameras.focal[0] * seen[:, :2] / ahead + np.array(plane.middle)
    return points if plane.lens is None else plane.lens.seen(points)


def _measured(values: Array) -> Measure:
    return Measure(float(values[0]), float(np.sqrt(np.square(values[1:] - values[0]).sum())))


def _rays(plane: BeltPlane, points: Array, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
    """Unit directions (n, 3) in belt coordinates through picture points (n, 2); cosines to the axis (n,)."""
    focal = plane.cameras.focal[chosen]
    direction = np.column_stack([points - plane.middle, focal])
    length = np.linalg.norm(direction, axis=1)
    return np.einsum(
        "nij,nj->ni", plane.cameras.rotation[chosen], direction / length[:, None]
    ), focal / length


def _radius(plane: BeltPlane, states: Array, chosen: NDArray[np.intp]) -> tuple[Array, bool]:
    """Radius (n,) of the sphere on the belt behind each box, mm; False where a ray does not go down."""
    direction, cosine = _rays(plane, states[:, :2], chosen)
    falls = -direction[:, 2]
    # Area of the ellipse in the box, as solid angle: off the axis a pixel covers less of it.
    solid = 0.25 * np.pi * states[:, 2] * states[:, 3] * cosine**3 / plane.cameras.focal[chosen] ** 2
    sine = np.sqrt(solid / np.pi)
    radius = plane.cameras.centre[chosen, 2] * sine / (falls + sine)
    return radius, bool(np.all(falls > 0))


def _meet(plane: BeltPlane, points: Array, chosen: NDArray[np.intp], height: Array | float) -> Array:
    """Where rays through picture points (n, 2) are at a height over the belt, mm (n, 3)."""
    direction, _ = _rays(plane, points, chosen)
    centre = plane.cameras.centre[chosen]
    falls = np.minimum(direction[:, 2], -1e-9)
    reach = (height - centre[:, 2]) / falls
    return centre + reach[:, None] * direction


def rectangle_of_width(corners_px: Array, width_mm: float, focal_px: float, size: tuple[int, int]) -> Array:
    """Places (4, 2) on the belt of a rectangle's corners: far left, far right, near right, near left.

    Its length follows from the focal length: both sides of the rectangle are seen by one camera.
    Raises ValueError for corners that no such camera can have seen.
    """
    unit = np.array([[0.0, 0.0], [width_mm, 0.0], [width_mm, 1.0], [0.0, 1.0]])
    matrix = homography(unit, np.asarray(corners_px, float) - np.array(size) / 2.0)
    across, along, _ = (np.array([*(column[:2] / focal_px), column[2]]) for column in matrix.T)
    length = float(np.linalg.norm(along) / np.linalg.norm(across))
    if not np.isfinite(length) or length <= 0:
        raise ValueError("calibration: the edges of the belt cannot be seen like that")
    return unit * (1.0, length)
