"""Pictures of the experiments."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Items
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from docs.experiments.traffic.scene import LEARNING, RATE, make_sequence
from lumpwatch.models.roi import Image
from lumpwatch.models.trackers.foreground import Foreground
from lumpwatch.models.trackers.tracked import TrackedObject
from tests.reproduction.paper3_jpda.simulation import (
    METHODS,
    SETTINGS,
    STEPS,
    TARGETS,
    Score,
    Setting,
    draw,
    jpda,
    run,
)
from tests.reproduction.paper3_jpda.system import OPTIONS, play

matplotlib.use("Agg")
Array = NDArray[np.float64]
COLOURS = ("tab:blue", "tab:cyan", "tab:orange", "tab:red")


def simulation(paper: Setting, path: Path) -> None:
    """Measurements of all steps beside the estimated tracks, as in the paper's Fig. 3; and a harder scene."""
    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    harder = next(s for s in SETTINGS if s.start == "crossing" and s.clutter == 20)
    for row, setting in enumerate((paper, harder)):
        scene = draw(setting, 0)
        track = run(scene, setting, jpda)
        left, right = (figure.add_subplot(2, 2, 2 * row + k) for k in (1, 2))
        points = np.vstack(scene.scans)
        left.plot(points[:, 0], points[:, 1], ".", color="0.35", markersize=1.5)
        left.set_title(f"{setting.name}: all measurements of {STEPS} steps", fontsize=10)
        for i in range(TARGETS):
            right.plot(scene.truth[:, i, 0], scene.truth[:, i, 1], color="0.8", lw=4.0)
            right.plot(track[:, i, 0], track[:, i, 1], lw=1.2)
        right.set_title("estimated tracks (grey: truth)", fontsize=10)
        for axes in (left, right):
            axes.set_xlabel("x (px)")
            axes.set_ylabel("y (px)")
        right.set_xlim(left.get_xlim())
        right.set_ylim(left.get_ylim())
    figure.savefig(path, dpi=100)


def curves(simulated: dict[Setting, dict[str, list[Score]]], path: Path) -> None:
    """Targets held and their error over clutter and over detection probability."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels: tuple[tuple[str, str, Callable[[Setting], bool], str], ...] = (
        ("dense", "false alarms a step", lambda s: s.start == "dense" and s.detection == 0.98, "clutter"),
        (
            "crossing",
            "false alarms a step",
            lambda s: s.start == "crossing" and s.detection == 0.98,
            "clutter",
        ),
        ("dense, 5 false alarms", "P_D", lambda s: s.start == "dense" and s.clutter == 5, "detection"),
    )
    for column, (title, label, chosen, over) in enumerate(panels):
        settings = sorted((s for s in simulated if chosen(s)), key=lambda s: float(getattr(s, over)))
        along = [getattr(s, over) for s in settings]
        upper, lower = (figure.add_subplot(2, 3, 1 + column + 3 * row) for row in (0, 1))
        for name, colour in zip(METHODS, COLOURS, strict=True):
            held = [100.0 * np.array([score.held for score in simulated[s][name]]) for s in settings]
            error = [np.nanmean([score.error for score in simulated[s][name]]) for s in settings]
            mean = np.array([h.mean() for h in held])
            reach = np.array([1.96 * h.std(ddof=1) / np.sqrt(len(h)) for h in held])
            upper.errorbar(along, mean, reach, marker="o", ms=3, capsize=2, color=colour, label=name)
            lower.plot(along, error, marker="o", ms=3, color=colour)
        upper.set_title(title, fontsize=10)
        upper.set_ylabel("tracked right through (%)")
        lower.set_ylabel("median error of those (px)")
        lower.set_xlabel(label)
        if over == "clutter":
            for axes in (upper, lower):
                axes.set_xscale("log")
                axes.set_xticks(along, [f"{value:g}" for value in along])
                axes.minorticks_off()
        if column == 0:
            upper.legend(fontsize=7)
    figure.savefig(path, dpi=100)


def traffic(sequences: Items[int], foreground: Callable[[], Foreground], path: Path) -> None:
    """The picture with most confirmed objects among those with a flagged rider well inside, and its mask's tracker."""
    best: tuple[int, Image | None, tuple[TrackedObject, ...], dict[int, list[Array]]] = (0, None, (), {})
    for seed in sequences[:4]:
        trails: dict[int, list[Array]] = {}

        def watch(frame: int, picture: Image, objects: tuple[TrackedObject, ...]) -> None:
            nonlocal best
            sure = tuple(one for one in objects if one.confirmed)
            for one in sure:
                trails.setdefault(one.id, []).append(one.box[:2])  # noqa: B023 - used within this round
            flagged = any(one.wrong_way and 60.0 < one.box[1] < 170.0 for one in sure)
            if flagged and len(sure) > best[0]:
                best = (len(sure), picture.copy(), sure, {k: list(v) for k, v in trails.items()})  # noqa: B023

        play(make_sequence(seed, LEARNING), foreground(), OPTIONS, watch=watch)
    _, picture, objects, trails = best
    if picture is None:
        raise RuntimeError("no wrong-way rider was flagged in the first sequences")
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    _annotate(figure.add_subplot(), picture, objects, trails)
    figure.savefig(path, dpi=110)


def _annotate(
    axes: Axes, picture: Image, objects: tuple[TrackedObject, ...], trails: dict[int, list[Array]]
) -> None:
    height, width = picture.shape[:2]
    axes.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), extent=(0, width, height, 0))
    for one in objects:
        colour = "red" if one.wrong_way else "cyan"
        x, y, w, h = one.box
        axes.add_patch(Rectangle((x - w / 2, y - h / 2), w, h, fill=False, color=colour, lw=1.5))
        trail = np.array(trails[one.id][-round(RATE) :])
        axes.plot(trail[:, 0], trail[:, 1], color=colour, lw=1.0, alpha=0.8)
        label = f"{one.id} wrong way" if one.wrong_way else str(one.id)
        axes.text(x + w / 2 + 2, y, label, color=colour, fontsize=8, va="center", clip_on=True)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(
        "confirmed objects, their way of the last second, and a rider against the direction", fontsize=9
    )
