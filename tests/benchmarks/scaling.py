"""Cost of a full step against the number of particles and of ROIs, in units of a stated step."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.benchmarks.scene import KINDS, Kind, make_run
from tests.benchmarks.timing import alternate

PARTICLES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)
ROIS = (1, 2, 3, 4, 6, 8)
REFERENCE = 2000
"""Costs are in units of a step with so many particles in one ROI, and the histogram likelihood."""
MODELS = 2

Costs = Mapping[Kind, Mapping[int, float]]


def run() -> tuple[Costs, Costs]:
    """Relative cost by particles, and by ROIs of `REFERENCE` particles each, for each likelihood."""
    reference = make_run("histogram", REFERENCE, MODELS).step
    by_particles: dict[Kind, dict[int, float]] = {}
    by_rois: dict[Kind, dict[int, float]] = {}
    for kind in KINDS:
        by_particles[kind] = {n: _cost(make_run(kind, n, MODELS).step, reference) for n in PARTICLES}
        by_rois[kind] = {n: _cost(make_run(kind, REFERENCE, MODELS, n).step, reference) for n in ROIS}
    return by_particles, by_rois


def _cost(step, reference) -> float:  # type: ignore[no-untyped-def]
    return alternate({"step": step, "reference": reference}, turns=9).ratio("step", "reference")


def plot(by_particles: Costs, by_rois: Costs, path: Path) -> None:
    """Both curves side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), constrained_layout=True)
    for kind, colour in zip(KINDS, ("tab:blue", "tab:orange"), strict=True):
        left.loglog(*zip(*by_particles[kind].items(), strict=True), "o-", color=colour, label=kind)
        right.plot(*zip(*by_rois[kind].items(), strict=True), "o-", color=colour, label=kind)
    left.set(xlabel="particles (one ROI)", title="Cost against particles")
    right.set(xlabel=f"ROIs ({REFERENCE} particles each)", title="Cost against ROIs", ylim=(0, None))
    left.set_ylabel(f"cost of a full step\n(histogram, {REFERENCE} particles, one ROI = 1)")
    for axes in (left, right):
        axes.grid(visible=True, which="major", alpha=0.4)
        axes.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)
