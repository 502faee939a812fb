"""Pictures of the experiments, in the manner of the paper's Figures 8 to 21."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lumpwatch.models.state import VY, X, Y, blank
from tests.footage import sketch
from tests.reproduction.paper1.methods import Method, Motions, make_filter
from tests.reproduction.paper1.runner import Result

matplotlib.use("Agg")
COLOURS = ("tab:blue", "tab:red", "tab:green")
AXIS = {"column": "column x (px)", "row": "row y (px)", "vertical_velocity": "vertical velocity (px/frame)"}


def draw(result: Result, path: Path) -> None:
    """Example frame, densities, prediction function and existence curves."""
    flat = result.prepared.experiment.component == "position"
    figure = Figure(figsize=(11.0, 7.8 if flat else 6.6), layout="constrained")
    grid = figure.add_gridspec(3 if flat else 2, 3)
    frame(figure.add_subplot(grid[0, 0]), result)
    if flat:
        cells = [figure.add_subplot(grid[row, col]) for row, col in ((0, 1), (0, 2), (1, 0), (1, 1), (1, 2))]
        maps(figure, cells, result)
    else:
        densities(figure.add_subplot(grid[0, 1]), result)
        prediction(figure.add_subplot(grid[0, 2]), result)
    existence(figure.add_subplot(grid[-1, :]), result)
    figure.savefig(path, dpi=100)


def frame(axes: Axes, result: Result) -> None:
    """One picture of the scene with the object's box, and its track as dots."""
    scene = result.scene
    there = np.flatnonzero(scene.present)
    chosen = there[len(there) // 2]
    picture = scene.pictures[chosen]
    if result.prepared.experiment.needs_footage:
        picture = sketch(picture)
    if picture.ndim == 2:
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255)
    else:
        axes.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    x, y, w, h = scene.boxes[chosen]
    axes.plot(scene.boxes[there, 0], scene.boxes[there, 1], ".", color="cyan", markersize=2, alpha=0.6)
    axes.add_patch(
        matplotlib.patches.Rectangle((x - w / 2, y - h / 2), w, h, fill=False, color="yellow", lw=1.5)
    )
    axes.set_title(f"frame {chosen} and the whole path", fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def densities(axes: Axes, result: Result) -> None:
    """p(x_{t-1} | alpha_t) over one component."""
    values, along = _line(result)
    motions = _motions(result)
    unit = _unit(result)
    for m, name in enumerate(result.prepared.experiment.names):
        axes.plot(along / unit, motions.densities.at(values)[:, m] * unit, color=COLOURS[m], label=name)
    axes.set_title("learned densities $p(x_{t-1} | \\alpha_t)$", fontsize=10)
    axes.set_xlabel(AXIS[result.prepared.experiment.component])
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8)


def prediction(axes: Axes, result: Result) -> None:
    """P(alpha_t | x_{t-1}, alpha_{t-1} = first model) for the last model, adaptive and fixed."""
    experiment = result.prepared.experiment
    values, along = _line(result)
    unit = _unit(result)
    last = len(experiment.kinds) - 1
    axes.plot(along / unit, _predicted(result, values)[:, last], color="tab:red", label="adaptive (Eq. 12)")
    axes.axhline(_motions(result).matrix[0, last], color="black", linestyle="--", label="fixed (Eq. 10)")
    axes.set_title(f"prediction of '{experiment.names[last]}' after '{experiment.names[0]}'", fontsize=10)
    axes.set_xlabel(AXIS[experiment.component])
    axes.set_ylim(0.0, 1.02)
    axes.legend(fontsize=8)


def maps(figure: Figure, cells: list[Axes], result: Result) -> None:
    """The same over both coordinates, as maps: each density, then each switch away from the first model."""
    experiment = result.prepared.experiment
    h, w = result.prepared.knowledge.roi.shape
    x, y = np.meshgrid(np.arange(0.5, w, 2.0), np.arange(0.5, h, 2.0))
    values = blank(x.size)
    values[:, X], values[:, Y] = x.ravel(), y.ravel()
    density = _motions(result).densities.at(values)
    rows = _predicted(result, values)
    fixed = _motions(result).matrix[0]
    panels: list[tuple[NDArray[np.float64], str, float | None]] = [
        (density[:, m], f"density: {name}", None) for m, name in enumerate(experiment.names)
    ]
    panels += [
        (rows[:, m], f"P({experiment.names[m]} | x, {experiment.names[0]}); fixed: {fixed[m]:.3f}", 1.0)
        for m in range(1, len(experiment.names))
    ]
    for axes, (shown, title, top) in zip(cells, panels, strict=True):
        image = axes.imshow(
            shown.reshape(x.shape), extent=(0, w, h, 0), cmap="viridis", vmin=0.0, vmax=top, aspect="equal"
        )
        axes.set_title(title, fontsize=9)
        axes.tick_params(labelsize=7)
        bar = figure.colorbar(image, ax=axes, shrink=0.6)
        bar.ax.tick_params(labelsize=7)


def existence(axes: Axes, result: Result) -> None:
    """P(E = 1) of the methods on the first test seed; shaded where the object is there."""
    scene = result.scene
    there = np.flatnonzero(scene.present)
    axes.axvspan(there[0], there[-1] + 1, color="0.93")
    for k in np.flatnonzero(scene.labels > 0):
        if scene.labels[k - 1] != scene.labels[k]:
            axes.axvline(float(k), color="0.75", lw=0.8)
    axes.axhline(0.5, color="0.5", linestyle=":")
    colours = iter(("tab:orange", "tab:green", "tab:purple", "tab:brown", "tab:pink"))
    for outcome in result.outcomes:
        if _is_variant(outcome.method):
            continue
        main = outcome.method.adaptive
        axes.plot(
            outcome.shown.existence,
            color="tab:blue" if main else next(colours),
            lw=2.4 if main else 1.2,
            zorder=3 if main else 2,
            label=outcome.method.name,
        )
    seed = result.prepared.experiment.test_seeds[0]
    axes.set_title(
        f"existence probability, test seed {seed} (grey: object there; lines: change of model)", fontsize=10
    )
    axes.set_xlabel("frame")
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlim(0, len(scene.pictures))
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=6, frameon=False)


def _is_variant(method: Method) -> bool:
    return method.adaptive and (method.order != "model_first" or method.form != "marginal")


def _motions(result: Result) -> Motions:
    return result.prepared.motions[0]


def _unit(result: Result) -> float:
    """Velocities are shown in pixels a frame."""
    if result.prepared.experiment.component == "vertical_velocity":
        return 1.0 / result.prepared.knowledge.steps.interval_s
    return 1.0


def _line(result: Result) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """States along the experiment's component, and the component's values."""
    knowledge, component = result.prepared.knowledge, result.prepared.experiment.component
    h, w = knowledge.roi.shape
    if component == "vertical_velocity":
        column, low, high = VY, knowledge.steps.states[:, VY].min(), knowledge.steps.states[:, VY].max()
        low, high = low - 0.1 * (high - low), high + 0.1 * (high - low)
    else:
        column, low, high = (X, 0.0, float(w)) if component == "column" else (Y, 0.0, float(h))
    along = np.linspace(low, high, 400)
    values = blank(len(along))
    values[:, column] = along
    return values, along


def _predicted(result: Result, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of Eq. 12 after the first model (n, M)."""
    prepared, outcome = result.prepared, result.outcomes[0]
    jdt = make_filter(
        prepared.experiment, outcome.method, prepared.knowledge, _motions(result), outcome.level
    )
    labels = np.zeros(len(values), dtype=np.intp)
    return jdt.switching.rows(values, labels, prepared.knowledge.steps.interval_s)[0]
