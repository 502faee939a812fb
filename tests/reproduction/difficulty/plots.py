"""The pictures of the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lumpwatch.service.offline.plots import new_figure, save_figure
from tests.reproduction.difficulty.judge import WANTED_PER_HOUR, title
from tests.reproduction.difficulty.results import Results, StyleResult

CURVES, HEAT, WARNINGS, SIZES = (f"difficulty{name}.png" for name in ("-curves", "", "-warnings", "-sizes"))


def draw(found: Results, folder: Path) -> None:
    """Draw what there is."""
    if found.styles:
        _curves(found, folder / CURVES)
        _warnings(found, folder / WARNINGS)
        _sizes(found, folder / SIZES)
    if found.matrix:
        _heat(found, folder / HEAT)


def _colour(found: Results, key: str) -> str:
    return f"C{found.plan.peers.index(key)}"


def _curves(found: Results, path: Path) -> None:
    fig = new_figure(12, 4.8)
    panels = np.atleast_1d(fig.subplots(1, len(found.styles), sharey=True))
    for panel, (style, result) in zip(panels, found.styles.items(), strict=True):
        for key, points in result.curves.items():
            seen = [(p.false_per_hour, p.detection_rate) for p in points]
            shown = [(x, y) for x, y in seen if x is not None and y is not None]
            colour = _colour(found, key)
            panel.plot(*zip(*shown, strict=True), marker=".", lw=1.2, ms=4, label=title(key), color=colour)
            cell = result.tested[key]
            if not cell.found:
                continue
            panel.plot(cell.per_hour, np.mean(cell.found), "o", mfc="none", ms=10, mew=1.6, color=colour)
        panel.axvline(WANTED_PER_HOUR, color="0.5", ls=":", lw=1.2)
        panel.set_xscale("symlog", linthresh=WANTED_PER_HOUR)
        panel.set_xlim(left=-0.4)
        panel.set(
            xlabel="false alarms an hour without lumps",
            title=f"standard scene, style {style}",
            ylim=(-0.03, 1.03),
        )
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("lumps announced 1 s before the fall, or earlier")
    handles, names = panels[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=4, fontsize="small")
    save_figure(fig, path)


def _warnings(found: Results, path: Path) -> None:
    fig = new_figure(12, 4.2)
    panels = np.atleast_1d(fig.subplots(1, len(found.styles), sharey=True))
    for panel, (style, result) in zip(panels, found.styles.items(), strict=True):
        _sorted_warnings(panel, found, result)
        panel.axvline(1.0, color="0.5", ls=":", lw=1.2)
        panel.set(
            xlabel="seconds before the fall", title=f"standard scene, style {style}", ylim=(-0.03, 1.03)
        )
        panel.set_xlim(left=0.0)
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("share of the lumps announced by then")
    handles, names = panels[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=4, fontsize="small")
    save_figure(fig, path)


def _sorted_warnings(panel: Any, found: Results, result: StyleResult) -> None:
    for key in found.plan.peers:
        waits = np.sort(result.tested[key].warnings_s)[::-1]
        if not len(waits):
            continue
        share = np.arange(1, len(waits) + 1) / len(waits)
        some = waits > 0.0
        panel.step(
            np.append(waits[some], 0.0),
            np.append(share[some], some.mean()),
            where="post",
            color=_colour(found, key),
            label=title(key),
        )


def _heat(found: Results, path: Path) -> None:
    names, keys = list(found.matrix), list(found.plan.peers)
    shares = np.array(
        [[np.mean(found.matrix[name][key].found or (np.nan,)) for key in keys] for name in names]
    )
    fig = new_figure(9.5, 1.8 + 0.21 * len(names))
    axes = fig.subplots()
    image = axes.imshow(shares, aspect="auto", cmap="RdYlGn", vmin=0.0, vmax=1.0)
    for i, name in enumerate(names):
        for j, key in enumerate(keys):
            cell = found.matrix[name][key]
            text = f"{sum(cell.found)}/{len(cell.found)}"
            if cell.false_alarms:
                text += f"   +{cell.false_alarms} false"
            axes.text(j, i, text, ha="center", va="center", fontsize=6.5)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_xticks(range(len(keys)), [title(key).replace(", ", ",\n") for key in keys], fontsize=8)
    axes.xaxis.tick_top()
    fig.colorbar(image, ax=axes, label="share announced in time", shrink=0.6 if len(names) < 20 else 0.3)
    save_figure(fig, path)


def _sizes(found: Results, path: Path) -> None:
    fig = new_figure(11, 4.2)
    panels = np.atleast_1d(fig.subplots(1, len(found.styles), sharey=True))
    for panel, (style, result) in zip(panels, found.styles.items(), strict=True):
        panel.set(xlabel="true longest diameter (mm)", title=f"at the alarm, style {style}")
        if result.sizes is None or not result.sizes.at_alarm.known.any():
            continue
        one = result.sizes.at_alarm
        known = one.known
        true, stated = one.true_mm[known], one.stated_mm[known]
        ends = np.stack([stated - one.low_mm[known], one.high_mm[known] - stated])
        panel.errorbar(true, stated, ends, fmt=".", lw=0.7, alpha=0.6)
        span = np.array([true.min(), true.max()])
        panel.plot(span, span, color="0.3", lw=1, ls="--")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("stated, with its 90 % interval (mm)")
    save_figure(fig, path)
