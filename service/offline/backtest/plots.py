"""A backtest as a picture: what each threshold costs and gives, and how early the lumps were announced."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lumpwatch.service.offline.backtest.curve import scores_at
from lumpwatch.service.offline.backtest.episodes import alarm_at
from lumpwatch.service.offline.backtest.run import Backtest, Result
from lumpwatch.service.offline.plots import new_figure, save_figure

_TICKS = (0.5, 0.8, 0.9, 0.97, 0.99, 0.997, 0.999, 0.9999)


def draw_backtest(found: Backtest, path: Path) -> None:
    """Write the picture. Raises PlotError."""
    fig = new_figure(15, 4.6)
    trade, rates, warnings = fig.subplots(1, 3)
    wanted = found.terms.false_alarms_per_hour
    for number, result in enumerate(found.results):
        colour = f"C{number}"
        _trade(trade, result, colour)
        _rates(rates, result, colour)
        _warnings(warnings, result, found, colour)
    for axis, line in ((trade, trade.axvline), (rates, rates.axhline)):
        line(wanted, color="0.5", ls=":", lw=1.2, label=f"wanted: {wanted:g} an hour")
        axis.legend(fontsize="small")
    most = max((p.false_per_hour or 0.0 for result in found.results for p in result.points), default=0.0)
    trade.set_xscale("symlog", linthresh=wanted)
    trade.set_xlim(-wanted / 4, 2.0 * max(most, wanted))
    trade.set(
        xlabel="false alarms an hour",
        ylabel=f"lumps announced {found.terms.least_warning_s:g} s before the lip, or earlier",
        ylim=(-0.03, 1.03),
        title="each threshold; ring: recommended, square: configured",
    )
    rates.set_yscale("symlog", linthresh=wanted)
    rates.set_xscale("logit")
    rates.set_ylim(bottom=0.0)
    rates.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS], rotation=45)
    rates.minorticks_off()
    rates.set(
        xlabel="raise_above", ylabel="false alarms an hour", title="dashed: the 95 % intervals end here"
    )
    warnings.axvline(found.terms.least_warning_s, color="0.5", ls=":", lw=1.2)
    warnings.set_xlim(left=0.0)
    warnings.set(
        xlabel="seconds before the lip",
        ylabel="share of the lumps announced by then",
        ylim=(-0.03, 1.03),
        title="warning time at the recommended threshold",
    )
    warnings.legend(fontsize="small")
    save_figure(fig, path)


def _trade(axis: Any, result: Result, colour: str) -> None:
    points = [p for p in result.points if p.detection_rate is not None and p.false_per_hour is not None]
    if not points:
        return
    axis.plot(
        [p.false_per_hour for p in points],
        [p.detection_rate for p in points],
        color=colour,
        marker=".",
        label=result.setup.name,
    )
    for point, marker in ((result.configured, "s"), (result.recommendation.point, "o")):
        if point is not None:
            axis.plot(
                point.false_per_hour, point.detection_rate, marker, color=colour, mfc="none", ms=11, mew=1.6
            )


def _rates(axis: Any, result: Result, colour: str) -> None:
    # A threshold of 1 (never an alarm) has no place on a logit axis.
    points = [p for p in result.points if p.false_per_hour is not None and 0.0 < p.raise_above < 1.0]
    if not points:
        return
    at = [p.raise_above for p in points]
    axis.plot(at, [p.false_per_hour for p in points], color=colour, marker=".", label=result.setup.name)
    axis.plot(at, [p.false_interval[1] for p in points], color=colour, ls="--", lw=1)


def _warnings(axis: Any, result: Result, found: Backtest, colour: str) -> None:
    config = alarm_at(result.setup.roi.alarm, result.chosen.raise_above)
    scores = scores_at(result.judged, config, found.terms)
    warned = [
        warned_s or 0.0
        for video, score in zip(result.judged, scores, strict=True)
        for lump, warned_s in zip(video.truth.lumps, score.warned_s, strict=True)
        if lump.counted
    ]
    if warned:
        ordered = np.sort(warned)[::-1]
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        announced = ordered > 0.0
        axis.step(
            np.append(ordered[announced], 0.0),
            np.append(share[announced], announced.mean()),
            where="post",
            color=colour,
            label=f"{result.setup.name}, above {config.raise_above:g}",
        )
