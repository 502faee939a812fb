"""The pictures of a shift's report, as SVG. Needs matplotlib (the `plot` extra)."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from datetime import datetime, tzinfo
from typing import Any

from lumpwatch.service.offline.plots import new_figure
from lumpwatch.service.shift import FLOOD, TEN_MINUTES_S, Figures, RoiRecord, Window, in_ten_minutes
from lumpwatch.service.storage import Span

SEEN, UNKNOWN = "#cfe8cf", "#d0d0d0"
_REASONS = ("#e8a33d", "#d9663a", "#8f6bb3", "#4f87b8", "#b0885a", "#c9688f", "#6aa39b", "#a3a13f")
_VERDICTS = {"true": ("#1f7a33", "o"), "false": ("#c0392b", "X"), "unsure": ("#7f8c8d", "D")}
_UNJUDGED = ("#2c3e50", "|")

Part = Callable[[Span], float]
"""Seconds of a span."""


def timeline(records: Sequence[RoiRecord], window: Window, zone: tzinfo) -> str:
    """A row a ROI: how much of each minute it saw, why not, and its alarms."""
    fig = new_figure(11.5, 1.0 + 0.75 * len(records))
    axis = fig.subplots()
    reasons = sorted({reason for record in records for span in record.spans for reason in span.blind_s})
    colours = {reason: _REASONS[k % len(_REASONS)] for k, reason in enumerate(reasons)}
    labelled: set[str] = set()

    def once(name: str) -> str | None:
        new = name not in labelled
        labelled.add(name)
        return name if new else None

    for row, record in enumerate(records):
        axis.barh(
            row, window.lasts_s / 3600, left=0, height=0.8, color=UNKNOWN, label=once("not watched"), zorder=1
        )
        parts: list[tuple[str, str, Part]] = [("seen", SEEN, lambda span: span.seen_s)]
        parts += [(reason, colours[reason], _part_of(reason)) for reason in reasons]
        for k, (name, colour, part) in enumerate(parts):
            under = [below for _, _, below in parts[:k]]
            if bars := _bars(record.spans, window, row, part, under):
                label = once(name)
                axis.bar(*bars, align="edge", color=colour, label=label, zorder=2, linewidth=0)
        for story in record.alarms:
            outcome = None if story.verdict is None else story.verdict.outcome.value
            colour, marker = _VERDICTS.get(outcome or "", _UNJUDGED)
            at = (story.raised.time_s - window.begin_s) / 3600
            name = f"alarm, {outcome}" if outcome else "alarm, not judged"
            axis.plot(at, row, marker, color=colour, ms=9, mew=2, label=once(name), zorder=5)
    axis.set_yticks(range(len(records)), ["/".join(record.place) for record in records])
    axis.set(xlim=(0, window.lasts_s / 3600), ylim=(len(records) - 0.5, -0.5))
    _hours(axis, window, zone)
    handles, names = axis.get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=6, frameon=False, fontsize="small")
    return _svg(fig)


def distributions(found: Figures) -> str:
    """Sizes, warning times and acknowledge times of all ROIs."""
    fig = new_figure(11.5, 2.9)
    panels = fig.subplots(1, 3)
    total = found["total"]
    for panel, key, label, colour in (
        (panels[0], "longest_mm", "longest diameter (mm)", "#8f6b3f"),
        (panels[1], "warning_s", "seconds to the lip when announced", "#4f87b8"),
        (panels[2], "acknowledge_s", "seconds until acknowledged", "#6aa39b"),
    ):
        values = total[key]["values"]
        panel.set(xlabel=label, ylabel="alarms")
        panel.yaxis.get_major_locator().set_params(integer=True)
        if values:
            # From zero on: a handful of values that hardly differ must not look spread out.
            high = max(*values, 1e-9) * 1.05
            panel.hist(values, bins=20, range=(min(0.0, *values), high), color=colour, edgecolor="white")
            panel.axvline(total[key]["median"], color="0.2", ls="--", lw=1.2)
            many = f" of {total[key]['count']} of {total['lumps']} lumps"
            panel.set_title(f"median {total[key]['median']:.3g}{many}", fontsize="medium")
        else:
            panel.set_title("none is known", fontsize="medium")
            panel.set(xticks=[], yticks=[])
    return _svg(fig)


def rates(records: Sequence[RoiRecord], window: Window, zone: tzinfo) -> str:
    """Alarms in each ten minutes, beside what EEMUA 191 calls a flood."""
    fig = new_figure(11.5, 2.3)
    axis = fig.subplots()
    times = [alarm.raised.time_s for record in records for alarm in record.alarms]
    counts = in_ten_minutes(times, window)
    width = TEN_MINUTES_S / 3600
    axis.bar([k * width for k in range(len(counts))], counts, width=width, align="edge", color="#4f87b8")
    axis.axhline(1, color="#1f7a33", ls=":", lw=1.2, label="acceptable on average")
    if max(counts, default=0) > FLOOD / 2:
        axis.axhline(FLOOD, color="#c0392b", ls=":", lw=1.2, label="flood above")
    axis.set(xlim=(0, window.lasts_s / 3600), ylabel="alarms in 10 min")
    axis.set_ylim(bottom=0, top=max(2, *counts, 0) * 1.15)
    axis.yaxis.get_major_locator().set_params(integer=True)
    _hours(axis, window, zone)
    axis.legend(fontsize="small", frameon=False, loc="upper right")
    return _svg(fig)


def _part_of(reason: str) -> Part:
    return lambda span: span.blind_s.get(reason, 0.0)


def _bars(
    spans: Sequence[Span], window: Window, row: int, part: Part, under: Sequence[Part]
) -> tuple[list[float], list[float], list[float], list[float]] | None:
    """Left, height, width and bottom of one part of every span, stacked on those under it."""
    left, height, width, bottom = [], [], [], []
    for span in spans:
        lasts_s, value = span.end_s - span.begin_s, part(span)
        if value <= 0.0 or lasts_s <= 0.0:
            continue
        below = sum(part(span) for part in under)
        begin_s, end_s = max(span.begin_s, window.begin_s), min(span.end_s, window.end_s)
        left.append((begin_s - window.begin_s) / 3600)
        width.append((end_s - begin_s) / 3600)
        bottom.append(row + 0.4 - 0.8 * below / lasts_s)
        height.append(-0.8 * value / lasts_s)
    return (left, height, width, bottom) if left else None


def _hours(axis: Any, window: Window, zone: tzinfo) -> None:
    """Local time on the axis, some eight marks."""
    from matplotlib.ticker import FixedLocator

    hours = window.lasts_s / 3600
    step = next(
        (spacing for spacing in (0.25, 0.5, 1, 2, 3, 4, 6, 12, 24) if hours / spacing <= 9), hours / 8
    )
    marks = [k * step for k in range(int(hours / step) + 1)]
    axis.xaxis.set_major_locator(FixedLocator(marks))
    shape = "%H:%M" if hours <= 36 else "%d %b %H:%M"
    axis.set_xticklabels(
        [f"{datetime.fromtimestamp(window.begin_s + 3600 * m, zone):{shape}}" for m in marks]
    )
    axis.tick_params(axis="y", length=0)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _svg(fig: Any) -> str:
    import matplotlib as mpl

    buffer = io.StringIO()
    # A fixed salt and no date: the same shift gives the same page.
    with mpl.rc_context({"svg.hashsalt": "lumpwatch", "svg.fonttype": "none", "font.family": "sans-serif"}):
        fig.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
