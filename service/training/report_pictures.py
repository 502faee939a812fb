"""The pictures of a training report, as PNG or SVG. Those by matplotlib need the `plot` extra."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from lumpwatch.models.jdt.switching import AdaptiveSwitching, conditional
from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.learning.validation import Bin
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import VX, VY, H, W, X, Y, blank
from lumpwatch.service.offline import draw_prior, new_figure
from lumpwatch.service.storage import Prior
from lumpwatch.service.training.cross_validation import HeldOut, Judged
from lumpwatch.service.training.dataset import Material

_STEP = 4
_SKETCH_W, _SKETCH_H = 220, 44
_GREEN, _RED = (90, 200, 90), (60, 60, 235)


def prior_png(prior: Prior) -> bytes:
    """Densities, prediction function, velocity and size by row."""
    content = io.BytesIO()
    draw_prior(prior, content)
    return content.getvalue()


def places_png(material: Material, learned: Learned) -> bytes:
    """Over the picture: where each model follows the first, and how large lumps are expected to be."""
    roi = material.footage.roi
    sample = max(material.footage.views, key=lambda view: len(view.objects)).view.gray
    models = range(1, min(len(learned.models), 4))
    height, width = roi.shape
    fig = new_figure(5.2 * (len(models) + 1), 0.6 + 4.4 * height / width)
    panels = np.atleast_1d(fig.subplots(1, len(models) + 1))
    for panel, m in zip(panels, models, strict=False):
        _draw_switching(fig, panel, sample, roi, learned, m)
    _draw_sizes(panels[-1], sample, material, learned)
    for panel in panels:
        panel.set(xticks=[], yticks=[])
    return _png(fig)


def _draw_switching(fig: Any, panel: Any, sample: Image, roi: Roi, learned: Learned, m: int) -> None:
    height, width = roi.shape
    ys, xs = np.mgrid[0:height:_STEP, 0:width:_STEP]
    states = blank(xs.size)
    states[:, X], states[:, Y] = xs.ravel(), ys.ravel()
    mean, _ = learned.profile.scaled(float(height)).at(states[:, Y])
    states[:, [VX, VY]], states[:, [W, H]] = mean[:, :2], np.exp(mean[:, 2:])
    switching = AdaptiveSwitching(
        conditional(learned.joint),
        learned.interval_s,
        np.zeros(len(learned.models), dtype=np.bool_),
        learned.density.scaled(float(height)),
    )
    rows, _ = switching.rows(states, np.zeros(len(states), dtype=np.intp), learned.interval_s)
    shares = rows[:, m].reshape(xs.shape)
    inside = roi.mask[::_STEP, ::_STEP] > 0
    panel.imshow(sample, cmap="gray", extent=(0, width, height, 0))
    over = panel.imshow(
        np.ma.masked_where(~inside, shares),
        extent=(0, width, height, 0),
        cmap="inferno",
        alpha=0.55,
        vmin=0.0,
        vmax=max(float(shares[inside].max()), 1e-3),
    )
    fig.colorbar(over, ax=panel, shrink=0.8, label="probability within one frame")
    panel.set(title=f"where {learned.models[m]} follows {learned.models[0]}")


def _draw_sizes(panel: Any, sample: Image, material: Material, learned: Learned) -> None:
    roi = material.footage.roi
    height, width = roi.shape
    panel.imshow(sample, cmap="gray", extent=(0, width, height, 0))
    states = np.concatenate([view.objects for view in material.footage.views])
    panel.scatter(states[:, X], states[:, Y], s=2, color="tab:cyan", alpha=0.4, linewidths=0)
    profile = learned.profile.scaled(float(height))
    column = float(np.median(states[:, X]))
    for share in (0.15, 0.4, 0.65, 0.9):
        row = float(np.quantile(states[:, Y], share))
        mean, spread = profile.at(np.array([row]))
        for deviation, style in ((-1, ":"), (0, "-"), (1, ":")):
            w, h = np.exp(mean[0, 2:] + deviation * spread[0, 2:])
            xs = column + w / 2 * np.array([-1, 1, 1, -1, -1])
            ys = row + h / 2 * np.array([-1, -1, 1, 1, -1])
            panel.plot(xs, ys, style, color="tab:orange", lw=1.4)
    panel.set(xlim=(0, width), ylim=(height, 0), title="labelled centres, expected sizes")


def reliability_png(bins: Sequence[Bin]) -> bytes:
    """Predicted probability against the observed share."""
    fig = new_figure(4.6, 4.2)
    panel = fig.subplots()
    panel.plot([0, 1], [0, 1], color="0.6", ls="--", lw=1)
    sizes = [12 + 8 * np.log1p(group.objects + group.background) for group in bins]
    panel.plot(
        [group.predicted for group in bins], [group.observed for group in bins], color="tab:blue", lw=1
    )
    panel.scatter(
        [group.predicted for group in bins], [group.observed for group in bins], s=sizes, color="tab:blue"
    )
    panel.set(
        xlim=(-0.03, 1.03),
        ylim=(-0.03, 1.03),
        xlabel="probability of a lump that the likelihood says",
        ylabel="share of lumps that held-out boxes show",
    )
    return _png(fig)


def _png(fig: Any) -> bytes:
    content = io.BytesIO()
    fig.savefig(content, dpi=90)
    return content.getvalue()


def sketch(held: HeldOut) -> str:
    """The lump (dark) against the hardest background (red) over time, as SVG."""
    times = np.array([judged.time_s for judged in held.judged])
    lines = np.array([[judged.ratio, judged.background] for judged in held.judged])
    low, high = min(float(lines.min()), -1.0), max(float(lines.max()), 1.0)
    across = (times - times[0]) / max(float(times[-1] - times[0]), 1e-9) * (_SKETCH_W - 4) + 2

    def down(values: Any) -> Any:
        return (high - values) / (high - low) * (_SKETCH_H - 4) + 2

    drawn = []
    for column, colour in ((0, "#1c4e80"), (1, "#c0392b")):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down(lines[:, column]), strict=True))
        drawn.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.3" points="{points}"/>')
    zero = f'<path d="M0 {down(0.0):.1f} H{_SKETCH_W}" stroke="#9aa5b1" stroke-dasharray="3 3"/>'
    label = f"log likelihood ratio of lump {held.lump.id} over time"
    return (
        f'<svg role="img" aria-label="{label}" width="{_SKETCH_W}" height="{_SKETCH_H}" '
        f'viewBox="0 0 {_SKETCH_W} {_SKETCH_H}">{zero}{"".join(drawn)}</svg>'
    )


def moment_bgr(material: Material, held: HeldOut, judged: Judged) -> Image:
    """The working picture of a moment: the labelled box in green, the hardest background in red."""
    view, moment = material.footage.views[judged.view], material.footage.moments[judged.view]
    factor = max(1, round(420 / max(view.view.gray.shape)))
    large = cv2.resize(view.view.gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
    out = np.asarray(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    boxes = [(view.objects[moment.tracks.index(held.lump.id)], _GREEN)]
    if judged.hardest is not None:
        boxes.append((judged.hardest, _RED))
    for state, colour in boxes:
        low, high = (state[[X, Y]] + sign * state[[W, H]] / 2 for sign in (-1, 1))
        first, last = ((round(float(p[0]) * factor), round(float(p[1]) * factor)) for p in (low, high))
        cv2.rectangle(out, first, last, colour, 2, cv2.LINE_AA)
    return out
