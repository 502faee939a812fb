"""Pictures of results: existence curves and learned priors. Needs matplotlib (the `plot` extra)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from lumpwatch.models.jdt.density import COMPONENTS, GridDensity
from lumpwatch.models.jdt.switching import AdaptiveSwitching, conditional
from lumpwatch.models.state import VY, X, Y, blank
from lumpwatch.service.core import Change, Decision, RoiResult
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior


class PlotError(LumpwatchError):
    """A picture cannot be drawn; the text says why."""


def new_figure(width: float, height: float) -> Any:
    """An empty figure that belongs to no window. Raises PlotError where matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PlotError("plots need matplotlib: pip install 'lumpwatch[plot]'") from error
    return Figure(figsize=(width, height), layout="constrained")


def save_figure(fig: Any, path: Path | BinaryIO) -> None:
    """Write a figure; raises PlotError where the file cannot be written."""
    try:
        fig.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise PlotError(f"{path}: cannot be written ({error})") from error


class ExistenceCurves:
    """Gathers existence and decision of every ROI over a replay."""

    def __init__(self, raise_above: Mapping[str, float] | None = None) -> None:
        """`raise_above` of each ROI is drawn where it is given. Raises PlotError."""
        new_figure(1, 1)  # says at once, not after an hour of replay, that matplotlib is missing
        self._times: dict[str, list[float]] = {}
        self._existence: dict[str, list[float]] = {}
        self._lump: dict[str, list[bool]] = {}
        self._blind: dict[str, list[str | None]] = {}
        self._raised: dict[str, list[float]] = {}
        self._above = dict(raise_above or {})

    def add(self, time_s: float, results: tuple[RoiResult, ...]) -> None:
        """The results of one frame."""
        for result in results:
            self._times.setdefault(result.roi, []).append(time_s)
            self._existence.setdefault(result.roi, []).append(result.existence)
            self._lump.setdefault(result.roi, []).append(result.decision is Decision.LUMP)
            blind = result.decision is Decision.BLIND
            why = None if not blind else "blind" if result.reason is None else result.reason.value
            self._blind.setdefault(result.roi, []).append(why)
            raised = self._raised.setdefault(result.roi, [])
            if result.transition is not None and result.transition.change is Change.RAISED:
                raised.append(time_s)

    def save(self, path: Path) -> None:
        """One panel a ROI: existence over time, LUMP and BLIND shaded, alarms marked."""
        rois = list(self._times)
        fig = new_figure(10, 1.0 + 2.2 * max(len(rois), 1))
        panels = np.atleast_1d(fig.subplots(max(len(rois), 1), 1, sharex=True))
        for panel, roi in zip(panels, rois, strict=False):
            times = np.array(self._times[roi]) - self._times[roi][0]
            panel.fill_between(
                times, 0, 1, where=self._lump[roi], color="tab:red", alpha=0.15, step="post", label="LUMP"
            )
            self._shade_blind(panel, roi, times)
            for at in self._raised[roi]:
                panel.plot(
                    at - self._times[roi][0], 1.0, "v", color="tab:red", ms=7, clip_on=False, label="alarm"
                )
            if roi in self._above:
                panel.axhline(self._above[roi], color="tab:red", lw=0.9, ls="--", label="raise_above")
            panel.plot(times, self._existence[roi], color="tab:blue", lw=1.2, label="P(lump exists)")
            panel.set(ylim=(-0.02, 1.02), ylabel="existence", title=roi)
        found: dict[str, Any] = {}
        for panel in panels:
            found |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
        fig.legend(found.values(), found.keys(), loc="outside upper center", ncols=6, fontsize="small")
        panels[-1].set_xlabel("time (s)")
        save_figure(fig, path)

    def _shade_blind(self, panel: Any, roi: str, times: Any) -> None:
        reasons = sorted({why for why in self._blind[roi] if why is not None})
        for k, reason in enumerate(reasons):
            where = [why == reason for why in self._blind[roi]]
            colour = _BLIND[k % len(_BLIND)]
            label = f"BLIND ({reason})"
            panel.fill_between(
                times, 0, 1, where=where, color=colour, alpha=0.35, step="post", label=label, lw=0
            )


_BLIND = ("#8f6bb3", "#e8a33d", "#4f87b8", "#b0885a", "#6aa39b")
_AXIS = {"row": "row", "column": "column", "vertical_velocity": "vertical velocity"}


def draw_prior(prior: Prior, path: Path | BinaryIO) -> None:
    """What a prior knows: densities, prediction function, velocity and size by row (paper 1, Fig. 5)."""
    learned = prior.learned
    fig = new_figure(11, 7.5)
    fig.suptitle(
        f"{prior.meta.camera}/{prior.meta.roi}: prior version {prior.version}, "
        f"from {prior.meta.source} ({learned.tracks} objects)"
    )
    (density, prediction), (speed, size) = fig.subplots(2, 2)
    if len(learned.density.components) == 1:
        _draw_density(prior, density, prediction)
    else:
        _draw_density_2d(learned.density, learned.models, density, prediction)
    rows = learned.profile.first_row + learned.profile.row_step * np.arange(len(learned.profile.mean))
    mean, spread = learned.profile.mean, learned.profile.spread
    for k, name in ((0, "along x"), (1, "along y")):
        speed.plot(rows, mean[:, k], label=name)
        speed.fill_between(rows, mean[:, k] - spread[:, k], mean[:, k] + spread[:, k], alpha=0.2)
    speed.set(xlabel="row (ROI heights)", ylabel="velocity (ROI heights / s)", title="velocity by row")
    speed.legend()
    for k, name in ((2, "width"), (3, "height")):
        size.plot(rows, np.exp(mean[:, k]), label=name)
        size.fill_between(
            rows, np.exp(mean[:, k] - spread[:, k]), np.exp(mean[:, k] + spread[:, k]), alpha=0.2
        )
    size.set(xlabel="row (ROI heights)", ylabel="size (ROI heights)", title="size by row")
    size.legend()
    save_figure(fig, path)


def _draw_density(prior: Prior, density: Any, prediction: Any) -> None:
    """p(x | alpha) of each model, and Eq. 12 against Eq. 10 for leaving the first model."""
    learned = prior.learned
    grid = learned.density
    axis = grid.origin[0] + grid.step[0] * np.arange(grid.values.shape[1])
    name = next(key for key, columns in COMPONENTS.items() if columns == grid.components)
    unit = "ROI heights / s" if grid.components == (VY,) else "ROI heights"
    for m, model in enumerate(learned.models):
        density.plot(axis, grid.values[m], label=f"p(x | {model})")
    density.set(xlabel=f"{_AXIS[name]} ({unit})", title="densities, Eq. 14")
    density.legend()
    states = blank(len(axis))
    states[:, grid.components[0]] = axis
    matrix = conditional(learned.joint)
    switching = AdaptiveSwitching(
        matrix, learned.interval_s, np.zeros(len(learned.models), dtype=np.bool_), grid
    )
    rows, _ = switching.rows(states, np.zeros(len(axis), dtype=np.intp), learned.interval_s)
    for m, model in enumerate(learned.models[1:], start=1):
        line = prediction.plot(axis, rows[:, m], label=f"to {model}, Eq. 12")
        prediction.axhline(
            matrix[0, m], color=line[0].get_color(), ls="--", lw=1, label=f"to {model}, Eq. 10"
        )
    prediction.set(
        xlabel=f"{_AXIS[name]} ({unit})",
        ylim=(-0.02, 1.02),
        title=f"next model after {learned.models[0]}",
    )
    if len(learned.models) > 1:
        prediction.legend()


def _draw_density_2d(grid: GridDensity, models: tuple[str, ...], first: Any, last: Any) -> None:
    """The densities of the first and the last model over the picture."""
    if grid.components != (X, Y):
        raise PlotError("a density over these components cannot be drawn")
    low = grid.origin
    high = grid.origin + grid.step * (np.array(grid.values.shape[1:]) - 1)
    for panel, m in ((first, 0), (last, len(models) - 1)):
        panel.imshow(grid.values[m].T, extent=(low[0], high[0], high[1], low[1]), aspect="equal")
        panel.set(title=f"p(x | {models[m]})", xlabel="column (ROI heights)", ylabel="row (ROI heights)")
