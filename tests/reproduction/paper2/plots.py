"""Pictures of the experiment, in the manner of the paper's Figures 1 to 3."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import ConstantPosition, ConstantVelocity, FreeAcceleration
from lumpwatch.models.trackers.foreground import MixtureForeground, blobs
from lumpwatch.models.trackers.imm_pf import ImmPfTracker, learn_linear
from lumpwatch.models.trackers.tracked import TrackedObject
from tests.footage import footage_folder, sketch
from tests.reproduction.paper2.footage import LEARNED, Learned, pictures
from tests.reproduction.paper2.methods import METHODS, OPTIONS
from tests.reproduction.paper2.runner import Objects, Outcome

matplotlib.use("Agg")
COLOURS = {"CP": "#e53935", "CV": "#43a047", "CA": "#1e63e9", "MP": "#fbc02d"}
COLUMNS = ("sfda", "ata", "n_modp", "motp")
HEADS = ("SFDA", "ATA", "N-MODP", "MOTP")
HIGHWAY_FPS = 30.0
"""The header of the file says 60; the cars' speed fits better with this."""
HIGHWAY_FRAMES, HIGHWAY_LEARNED = 500, 250


def table(outcomes: dict[str, list[Outcome]], path: Path) -> None:
    """Bars of the four scores: the paper's, ours on the whole sequence and on the second half."""
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    cells = figure.subplots(2, 2)
    x = np.arange(len(METHODS))
    for axes, column, head in zip(cells.flat, COLUMNS, HEADS, strict=True):
        bars = [
            ("paper", "0.75", [[getattr(m, column)] * 3 for m in METHODS]),
            ("whole sequence", "tab:blue", [quartiles(outcomes[m.name], "whole", column) for m in METHODS]),
            ("second half", "tab:orange", [quartiles(outcomes[m.name], "second", column) for m in METHODS]),
        ]
        for k, (label, colour, values) in enumerate(bars):
            low, middle, high = np.array(values).T
            axes.bar(x + 0.27 * (k - 1), middle, 0.25, color=colour, label=label)
            if k:
                axes.errorbar(
                    x + 0.27 * (k - 1),
                    middle,
                    [middle - low, high - middle],
                    fmt="none",
                    ecolor="black",
                    lw=1,
                )
        axes.set_title(head, fontsize=11)
        axes.set_ylim(0.0, 1.0)
        axes.set_xticks(x, [m.name for m in METHODS], fontsize=7)
        axes.grid(axis="y", alpha=0.3)
    cells[0, 0].legend(fontsize=8, ncols=3)
    figure.savefig(path, dpi=100)


def quartiles(outcomes: Sequence[Outcome], part: str, column: str) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile of a score."""
    values = [getattr(outcome.scores[part], column) for outcome in outcomes]
    low, middle, high = np.percentile(values, [25, 50, 75])
    return float(low), float(middle), float(high)


def paths(shown: Outcome, video: Path, names: Sequence[str], path: Path) -> None:
    """Trajectories of the feet over a picture, coloured by the leading model."""
    background = next(pictures(video))
    figure = Figure(figsize=(12.0, 4.8), layout="constrained")
    halves = (range(LEARNED), range(LEARNED, len(shown.objects)))
    for axes, frames in zip(figure.subplots(1, 2), halves, strict=True):
        axes.imshow(sketch(background))
        _trails(axes, [shown.objects[k] for k in frames], names)
        axes.set_title(f"frames {frames.start + 1} to {frames.stop}", fontsize=10)
        axes.set_xlim(0, background.shape[1])
        axes.set_ylim(background.shape[0], 0)
        axes.set_axis_off()
    figure.legend(
        handles=[Line2D([], [], color=COLOURS[name], lw=3, label=f"{name} leads") for name in names],
        loc="lower center",
        ncols=len(names),
        fontsize=9,
    )
    figure.savefig(path, dpi=100)


def _trails(axes: Axes, objects: Objects, names: Sequence[str]) -> None:
    tracks: dict[int, list[TrackedObject]] = {}
    for some in objects:
        for one in some:
            if one.confirmed:
                tracks.setdefault(one.id, []).append(one)
    for track in tracks.values():
        feet = np.array([(one.box[0], one.box[1] + one.box[3] / 2) for one in track])
        colours = [COLOURS[names[int(one.model_shares.argmax())]] for one in track]
        axes.add_collection(
            LineCollection(list(np.stack([feet[:-1], feet[1:]], axis=1)), colors=colours[1:], linewidths=1.8)
        )


def frame(shown: Outcome, video: Path, learned: Learned, path: Path) -> None:
    """The picture of the second half with most targets: boxes, ids and bars of model shares."""
    counts = [sum(one.confirmed for one in some) for some in shown.objects[LEARNED:]]
    best = LEARNED + int(np.argmax(counts))
    picture = sketch(next(islice(pictures(video), best, None)))
    _annotate(picture, shown.objects[best])
    cv2.imwrite(str(path), picture)


def _annotate(picture: NDArray[np.uint8], objects: Sequence[TrackedObject]) -> None:
    """Boxes, ids, and above each box the bar of Fig. 1(a): red CP, green CV, blue CA."""
    for one in objects:
        if not one.confirmed:
            continue
        corners = np.concatenate([one.box[:2] - one.box[2:] / 2, one.box[:2] + one.box[2:] / 2])
        left, top, right, bottom = (int(v) for v in corners.round())
        cv2.rectangle(picture, (left, top), (right, bottom), (0, 120, 200), 1)
        cv2.putText(
            picture, str(one.id), (left, bottom + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 120, 200), 1
        )
        edges = left + np.concatenate([[0.0], np.cumsum(one.model_shares)]) * (right - left)
        for start, end, name in zip(edges[:-1], edges[1:], COLOURS, strict=False):
            bgr = [int(COLOURS[name][i : i + 2], 16) for i in (5, 3, 1)]
            cv2.rectangle(picture, (round(start), top - 7), (round(end), top - 2), bgr, -1)


def highway(path: Path) -> str:
    """Cars: box sizes from the regions themselves, for a look. Says what is shown, or why nothing is."""
    folder = footage_folder("highway", "video03.avi")
    if folder is None:
        return ""
    frames = list(islice(pictures(folder / "video03.avi"), HIGHWAY_FRAMES))
    foreground = MixtureForeground()
    found = [blobs(foreground.apply(picture), 120) for picture in frames[:HIGHWAY_LEARNED]]
    labelled = np.concatenate(found[50:])
    size = learn_linear(labelled[labelled[:, 3] < frames[0].shape[0] / 3])
    models = (ConstantPosition("CP", 6.0), ConstantVelocity("CV", 30.0), FreeAcceleration("CA", 80.0))
    tracker = ImmPfTracker(OPTIONS, models, size, MixtureForeground(), np.random.default_rng(0))
    objects = [tracker.step(picture, 1.0 / HIGHWAY_FPS) for picture in frames]
    counts = [sum(one.confirmed for one in some) for some in objects[HIGHWAY_LEARNED:]]
    best = HIGHWAY_LEARNED + int(np.argmax(counts))
    picture = sketch(frames[best])
    _annotate(picture, objects[best])
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    left.set_title(f"frame {best + 1}", fontsize=10)
    right.imshow(sketch(frames[0]))
    _trails(right, objects, ("CP", "CV", "CA"))
    right.set_title(f"paths over {len(frames)} frames", fontsize=10)
    for axes in (left, right):
        axes.set_axis_off()
    figure.savefig(path, dpi=100)
    ids = {one.id for some in objects for one in some if one.confirmed}
    return f"{len(ids)} tracks in {len(frames)} frames"
