"""The camera over a belt, from points of the belt whose places are known.

Where the points are exact, their homography alone gives the camera with square pixels and the principal point in the
middle of the picture (Zhang 2000, section 3.1). A person with a tape is off by some per cent, and then there may be no
such camera, or one with an absurd angle of view: seen from straight above, the points hardly tell the focal length.
So the camera is also sought that misses the points least (reprojection error; Hartley, Zisserman 2004, section 4.2.3),
with what is known of cameras before any point is seen: half of them see between 43 and 85 degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, radians, tan

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

USUAL_VIEW_DEG = 62.0
"""Horizontal angle of view that cameras are expected to have."""
VIEW_SPREAD = 0.6
"""Standard deviation of the log focal length around it."""
LARGEST_VIEW_DEG, SMALLEST_VIEW_DEG = 150.0, 4.0
_STARTS = (1.0, 0.5, 2.0)  # times the expected focal length


@dataclass(frozen=True, slots=True)
class Pose:
    """One pinhole camera with square pixels."""

    focal: float
    """px"""
    rotation: Array
    """Rows: the axes of the belt (along its x, its y, and up) in the camera's frame (3, 3)."""
    centre: Array
    """The camera's place in belt coordinates, mm (3,)."""

    def project(self, points_mm: Array) -> Array:
        """Picture coordinates (n, 2), px from the principal point, of places on the belt (n, 2)."""
        seen = (np.column_stack([points_mm, np.zeros(len(points_mm))]) - self.centre) @ self.rotation
        return self.focal * seen[:, :2] / seen[:, 2:]


def homography(source: Array, target: Array) -> Array:
    """3x3, source (n, 2) to target (n, 2), least squares of the algebraic error after normalising.

    Raises ValueError where the points do not fix it.
    """
    source, from_source = _normalised(source)
    target, from_target = _normalised(target)
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, -u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, -v])
    _, singular, vectors = np.linalg.svd(np.array(rows, float))
    # One vector solves the system; a second one means that the points do not fix the plane.
    if singular[7] < 1e-6 * singular[0]:
        raise ValueError("calibration: too many of the points lie on one line")
    found = np.linalg.inv(from_target) @ vectors[-1].reshape(3, 3) @ from_source
    return np.asarray(found / np.linalg.norm(found))


def exact_pose(matrix: Array, inside: Array) -> Pose | None:
    """The camera of a homography belt -> picture; None where no camera with square pixels has it.

    `inside` is a place on the belt that the camera sees.
    """
    columns = _in_front(matrix, inside)
    first, second, _ = columns
    # r1 and r2 are orthogonal and of one length: two equations for 1 / f^2.
    known = np.array([first[:2] @ second[:2], first[:2] @ first[:2] - second[:2] @ second[:2]])
    wanted = -np.array([first[2] * second[2], first[2] ** 2 - second[2] ** 2])
    inverse = float(known @ wanted) / max(float(known @ known), 1e-300)
    if not inverse > 0:
        return None
    f = 1.0 / np.sqrt(inverse)
    r1, r2, t = (np.array([*(column[:2] / f), column[2]]) for column in columns)
    scale = 2.0 / (np.linalg.norm(r1) + np.linalg.norm(r2))
    r1, r2, t = scale * r1, scale * r2, scale * t
    r1 = r1 / np.linalg.norm(r1)
    r2 = r2 - r1 * (r1 @ r2)
    return _posed(f, r1, r2 / np.linalg.norm(r2), t)


def best_poses(points_mm: Array, pictures_px: Sequence[Array], error_px: float, width: float) -> list[Pose]:
    """The cameras that miss picture points (n, 2), px from the principal point, by the least.

    `points_mm` (n, 2) are their places on the belt, `error_px` how well they are known, `width` that of the picture.
    The second and all further `pictures_px` are the first one with its points moved a little. Raises ValueError where
    the points do not fix the plane.
    """
    # Only who has a calibrated camera loads it.
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    inside = points_mm.mean(axis=0)
    reach = float(np.linalg.norm(points_mm - inside, axis=1).max())
    usual = 0.5 * width / tan(radians(USUAL_VIEW_DEG) / 2)
    flat = (points_mm - inside) / reach

    def residual(x: Array, points_px: Array) -> Array:
        seen = flat @ Rotation.from_rotvec(x[1:4]).as_matrix()[:, :2].T + x[4:]
        missed = usual * np.exp(x[0]) * seen[:, :2] / np.maximum(seen[:, 2:], 1e-3) - points_px
        return np.append(missed.ravel() / error_px, x[0] / VIEW_SPREAD)

    def pose(x: Array) -> Pose:
        axes = Rotation.from_rotvec(x[1:4]).as_matrix()
        return _posed(
            usual * float(np.exp(x[0])), axes[:, 0], axes[:, 1], x[4:] * reach - axes[:, :2] @ inside
        )

    columns = _in_front(homography(points_mm, pictures_px[0]), inside)
    starts = [np.append(log(f), _start(columns, f * usual, inside, reach)) for f in _STARTS]
    found = [least_squares(residual, start, x_scale="jac", args=(pictures_px[0],)) for start in starts]
    best = min(found, key=lambda one: float(one.cost)).x
    moved = [least_squares(residual, best, method="lm", args=(one,)).x for one in pictures_px[1:]]
    return [pose(x) for x in (best, *moved)]


def misses(pose: Pose, points_mm: Array, points_px: Array) -> float:
    """By how much the camera misses the points, px, root mean square over both coordinates."""
    return float(np.sqrt(np.square(pose.project(points_mm) - points_px).mean()))


def view_deg(focal_px: float, width: float) -> float:
    """Horizontal angle of view of a camera with that focal length in a picture of that width."""
    return float(np.degrees(2.0 * np.arctan(0.5 * width / focal_px)))


def _in_front(matrix: Array, inside: Array) -> Array:
    """The columns of a homography, its sign such that `inside` lies before the camera."""
    return np.where(float(matrix[2] @ (*inside, 1.0)) > 0, 1.0, -1.0) * matrix.T


def _start(columns: Array, f: float, inside: Array, reach: float) -> Array:
    """Rotation vector and place of `inside` in the camera's frame, in `reach`, by a homography and a focal length."""
    from scipy.spatial.transform import Rotation

    scaled = np.column_stack([columns[:, :2] / f, columns[:, 2]])
    left, sizes, right = np.linalg.svd(scaled[:2].T, full_matrices=False)
    axes = left @ right  # the nearest two orthogonal unit vectors
    t = scaled[2] / sizes.mean() + axes @ inside
    rotation = np.column_stack([axes, np.cross(axes[:, 0], axes[:, 1])])
    return np.concatenate([Rotation.from_matrix(rotation).as_rotvec(), t / reach])


def _posed(focal: float, r1: Array, r2: Array, t: Array) -> Pose:
    axes = np.stack([r1, r2, np.cross(r1, r2)])
    place = -axes @ t
    if place[2] < 0:  # belt coordinates may be left-handed as seen by the camera: up is towards it
        axes[2], place[2] = -axes[2], -place[2]
    return Pose(float(focal), axes, place)


def _normalised(points: Array) -> tuple[Array, Array]:
    centre = points.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.linalg.norm(points - centre, axis=1).mean()), 1e-12)
    matrix = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
    return (points - centre) * scale, matrix
