"""`lumpwatch lens`: how a lens bends the picture, from edges that are straight in the world."""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.lens import find_lens
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.errors import ConfigError

_MOST_OFF_PX = 4.0


def lens(arguments: argparse.Namespace) -> int:
    """Run the command."""
    size = arguments.size
    edges = [np.array([_point(text, size) for text in edge]) for edge in arguments.edge]
    try:
        found, off_px = find_lens(edges, size)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    before_px = _off_lines(edges)
    if off_px > _MOST_OFF_PX:
        raise ConfigError(
            f"the edges contradict each other: straightened as well as can be, their points lie {off_px:.1f} px off "
            "straight lines (rms); are they all straight in the world?"
        )
    if arguments.json:
        tell_json({"k1": found.k1, "k2": found.k2, "off_px": off_px, "off_before_px": before_px})
        return 0
    sys.stdout.write(
        f"lens: {{k1: {found.k1:.4f}, k2: {found.k2:.4f}}}\n"
        f"# the points lie {off_px:.1f} px off straight lines (rms), {before_px:.1f} px as they are\n"
    )
    return 0


def _off_lines(edges: list[NDArray[np.float64]]) -> float:
    """How far the points are off straight lines as they are, px (rms)."""
    off = []
    for edge in edges:
        centred = edge - edge.mean(axis=0)
        off.append(centred @ np.linalg.svd(centred)[2][1])
    return float(np.sqrt(np.mean(np.square(np.concatenate(off)))))


def _point(text: str, size: tuple[int, int]) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--edge {text}: is not a point such as 80,40") from None
    if not (0 <= x <= size[0] and 0 <= y <= size[1]):
        raise ConfigError(f"--edge {text}: lies outside the picture")
    return x, y
