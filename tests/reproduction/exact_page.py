"""Page and pictures of the comparison with the exact posterior."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lumpwatch.models import AdaptiveSwitching, blank, plot
from lumpwatch.models.jdt.filter import Form, Step
from lumpwatch.models.state import Y

Array = NDArray[np.float64]
DT, FRAMES, ENTERS, ROWS, SIDE = 0.1, 90, 15, 160, 10
CONTRAST = 0.7
"""The lump's brightness in standard deviations of the noise."""
SHOWN = (300, 3000)
"""Numbers of particles of the picture."""
KNOTS = np.arange(-40.0, 400.0, 0.5) + 0.25
EDGES = np.arange(-40.0, 400.0 + 1e-9, 4.0)
"""Beyond the strip as well: what has fallen out of sight still exists until it dies."""
FORMS: tuple[Form, ...] = ("marginal", "sampled")


@dataclass(frozen=True)
class Errors:
    """Of one form and number of particles, means over frames and runs."""

    existence: float
    """Mean absolute difference of P(E = 1)."""
    posterior: float
    """Total variation between the posteriors of (E, row) in cells of 4 px."""
    bias: float
    """The largest difference, in any frame, of the mean of all runs to the exact existence."""


def draw(
    path: Path,
    clip: Array,
    rows: Array,
    truth: tuple[Array, Array, Array],
    switching: AdaptiveSwitching,
    shown: tuple[list[Step], list[Step]],
) -> None:
    """Pictures, law of switching, both posteriors, existence and models; `shown`: the steps of `SHOWN` particles."""
    existence, cells, falls = truth
    times = DT * np.arange(FRAMES)
    there = (DT * ENTERS, DT * float(np.flatnonzero(rows < ROWS)[-1] + 1))
    _, many = shown
    figure = Figure(figsize=(12, 10), layout="constrained")
    axes = figure.subplots(3, 2)
    axes[0, 0].imshow(clip.T, cmap="gray", aspect="auto", extent=(0, times[-1], ROWS, 0))
    axes[0, 0].set(title="pictures: one column each", xlabel="time (s)", ylabel="row (px)")
    states = blank(ROWS)
    states[:, Y] = np.arange(ROWS)
    plot.switching(axes[0, 1], switching, states, Y, 0, DT, ("belt", "fall"))
    axes[0, 1].set(title="what comes after a step on the belt, by row (Eq. 12)")
    most = float(cells.max())
    plot.density(axes[1, 0], times, EDGES, cells, vmax=most)
    axes[1, 0].set(title="posterior of the row, exact", ylim=(ROWS + 20, -10))
    plot.density(axes[1, 1], times, EDGES, [plot.share(step.belief, Y, EDGES) for step in many], vmax=most)
    axes[1, 1].set(title=f"{SHOWN[1]:,} particles", ylim=(ROWS + 20, -10))
    for axis in axes[1]:
        axis.plot(times, rows, color="tab:cyan", lw=0.8, label="truth")
        axis.legend(loc="lower left")
    for axis in axes[2]:
        axis.axvspan(*there, color="0.92", zorder=0)
    for steps, name in zip(shown, (f"{number:,} particles" for number in SHOWN), strict=True):
        plot.existence(axes[2, 0], times, [step.belief.existence for step in steps], label=name, lw=1.0)
        share = [step.belief.labels.mean() for step in steps]
        axes[2, 1].plot(times, share, label=name, lw=1.0)
    plot.existence(axes[2, 0], times, existence, label="exact", color="k", ls="--")
    axes[2, 0].set(title="existence; grey: the lump is in the strip")
    axes[2, 1].plot(times, falls, "k--", label="exact")
    axes[2, 1].set(title="share of the model that falls, given existence", xlabel="time (s)")
    for axis in axes[2]:
        axis.legend()
    figure.savefig(path, dpi=80)


def draw_errors(path: Path, table: dict[tuple[Form, int], Errors]) -> None:
    """Total variation by the number of particles."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axis = figure.subplots()
    for form in FORMS:
        numbers = [number for name, number in table if name == form]
        axis.loglog(numbers, [table[form, n].posterior for n in numbers], "o-", label=form)
    numbers = sorted({number for _, number in table})
    first = table["marginal", numbers[0]].posterior
    axis.loglog(numbers, first * np.sqrt(numbers[0] / np.array(numbers)), "k:", label="1 / sqrt(N)")
    axis.set(xlabel="particles", ylabel="total variation to the exact posterior")
    axis.legend()
    figure.savefig(path, dpi=80)


def write(told: str, table: dict[tuple[Form, int], Errors], seeds: int) -> str:
    """The page; `told` is the docstring of the experiment."""
    lines = [
        f"| {form} | {number:,} | {e.existence:.4f} | {e.posterior:.3f} | {e.bias:.4f} |"
        for (form, number), e in table.items()
    ]
    return "\n".join([
        "<!-- Written by `python -m tests.reproduction exact`. -->",
        "",
        "# The filter of paper 1 beside the exact posterior",
        "",
        told.partition("\n\n")[2].strip(),
        "",
        f"A strip of {ROWS} pixels, {1 / DT:.0f} pictures a second; the lump is {SIDE} px long and brighter than the "
        f"ground by {CONTRAST:g} standard deviations of the noise, so that no single picture shows it.",
        f"The exact filter sums over {len(KNOTS)} places, two models and existence; models are drawn before the state.",
        "",
        "![Exact posterior and particles](../images/exact.png)",
        "",
        f"Errors over {FRAMES} pictures and {seeds} runs that differ in the seed. Total variation is that of the joint",
        "posterior of existence and row, in cells of 4 px: 0 is equal, 1 is disjoint; a histogram of N draws from the",
        "exact posterior is not at 0 either. The last column is the difference of the mean of all runs in the worst",
        "picture: what does not average out.",
        "",
        "| form of existence | particles | difference of existence | total variation | of the mean, worst picture |",
        "|---|---|---|---|---|",
        *lines,
        "",
        "![Error by the number of particles](../images/exact_errors.png)",
        "",
        "The tests hold the same for both orders of drawing, with a fixed matrix and adaptive, and for the evidence",
        "(`tests/models/test_jdt_oracles.py`). Drawn with [`lumpwatch.models.plot`](../models.md).",
        "",
    ])  # fmt: skip
