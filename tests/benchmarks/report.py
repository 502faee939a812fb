"""Writes docs/results/speed.md and its picture from the figures of a run."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.service.detection.shipped_likelihood import default_likelihood
from tests.benchmarks import background, peers, scaling

DOCS = Path(__file__).parents[2] / "docs"
PAGE, PICTURE = DOCS / "results" / "speed.md", DOCS / "images" / "speed_scaling.png"
Rows = Sequence[Mapping[str, object]]


def table(rows: Rows) -> str:
    """A Markdown table; numbers with three significant digits, large ones whole."""
    heads = list(rows[0])
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    lines += [f"| {' | '.join(_shown(row[head]) for head in heads)} |" for row in rows]
    return "\n".join(lines)


def _shown(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def peer_rows(rows: Rows) -> Rows:
    """What the page shows of `peers.run`."""
    return [
        {
            "Stone Soup filter": row["peer"],
            "particles": row["particles"],
            "motion models": row["models"],
            "positions a frame (theirs)": row["positions"],
            "likelihood of a picture (ours)": row["likelihood"],
            "times faster": row["ratio"],
            "theirs (ms)": row["theirs_ms"],
            "ours (ms)": row["ours_ms"],
        }
        for row in rows
    ]


def background_rows(rows: Rows) -> Rows:
    """What the page shows of `background.run`."""
    return [
        {
            "likelihood": row["likelihood"],
            "share of MOG2's time": row["share"],
            "ours (ms)": row["ours_ms"],
            "MOG2 (ms)": row["mog2_ms"],
        }
        for row in rows
    ]


def scaling_rows(by_particles: scaling.Costs, by_rois: scaling.Costs) -> tuple[Rows, Rows]:
    """Relative costs, a column for each number."""
    by_n = [
        {"likelihood": kind, **{f"{n:,}": c for n, c in costs.items()}}
        for kind, costs in by_particles.items()
    ]
    by_roi = [
        {"likelihood": kind, **{str(n): c for n, c in costs.items()}} for kind, costs in by_rois.items()
    ]
    return by_n, by_roi


def write(
    peer: Rows | None, mog2: Rows, costs: tuple[scaling.Costs, scaling.Costs], whole: Mapping[str, float]
) -> None:
    """The page and its picture; without Stone Soup its section says so."""
    scaling.plot(*costs, PICTURE)
    by_n, by_roi = scaling_rows(*costs)
    stone_soup = peers.stone_soup_version()
    PAGE.write_text(
        f"""<!-- Written by `make bench`. -->

# Speed

CPU time on one thread ({os.cpu_count()} cores, Python {platform.python_version()}, \
NumPy {version("numpy")}, numba {version("numba")}).
What is compared takes turns in one process; figures are medians over the turns, so ratios hold better
than times. A full step is everything from the working picture of 320 x 240 to
the estimate: integral images, adaptive switching, motion, births, weights, resampling.

## Against Stone Soup {stone_soup or ""}

Same number of particles, three tenths of them newborn at each step where there are births, and the
same number of constant velocity models in two dimensions. Ours computes each particle's likelihood
from a whole picture. Stone Soup is handed positions that some detector would have found: one a
frame, the least there can be, or ten, as in clutter; finding them is not counted. Its cost grows with
the positions, ours does not depend on what the picture shows. It works on whole arrays as well, which
leaves less to gain than a loop over particles would; its multi-model filter also has no births and no
existence to compute. The lump likelihood takes {len(FEATURES)} measures of each particle's box and weighs
{len(default_likelihood().patterns.offsets)} patterns of them, which is most of its step: it does the finding that
Stone Soup leaves to a detector.

{table(peer_rows(peer)) if peer else "Left out in this run: Stone Soup is not installed."}

nchopin's `particles` 0.4 asks for NumPy below 2 and cannot be installed beside this project.

## Against OpenCV's MOG2

The same grey picture of 320 x 240, {background.PARTICLES:,} particles, {background.MODELS} motion models.

{table(background_rows(mog2))}

## Whole pipeline

Replay of 1920 x 1080 H.264 with one ROI takes **{whole["ratio"]:.2f}** times the CPU time of bare decoding;
live over RTSP, with both processes and the bus, {whole["live_ratio"]:.2f} times.
[Stage by stage](cost.md).

## Cost against particles and ROIs

In units of a full step with {scaling.REFERENCE:,} particles in one ROI and the histogram likelihood.
The cost of few particles is that of the picture.

![Cost of a full step against the number of particles and of ROIs](../images/{PICTURE.name})

By particles:

{table(by_n)}

By ROIs:

{table(by_roi)}
""",
        encoding="utf-8",
    )
