"""What `lumpwatch backtest` says of a configuration."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from lumpwatch.service.offline import Backtest, Point, Result

_SHOWN = (0.5, 0.7, 0.8, 0.9, 0.96, 0.99, 0.999, 0.9999)


def print_result(console: Console, result: Result, found: Backtest) -> None:
    """The table of one configuration, and what it does not say."""
    chosen = result.recommendation.point
    shown = [p for p in result.points if p.raise_above in _SHOWN or p in (chosen, result.configured)]
    prior = f"prior version {result.setup.prior.version}" if result.setup.prior else "stated defaults"
    table = Table(
        padding=(0, 0), title=f"{result.setup.name}: {result.setup.camera.id}/{result.setup.roi.id}, {prior}"
    )
    for heading in (
        "raise\nabove",
        "announced\n(95 %)",
        "warning s\nmid|worst",
        "false an hour\n(95 %)",
        "true",
        "mis-\nplaced",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for point in shown:
        marks = [
            word
            for word, is_it in (("config.", point == result.configured), ("advised", point == chosen))
            if is_it
        ]
        table.add_row(*_cells(point), ", ".join(marks), style="bold" if point == chosen else "")
    console.print(table)
    for line in _words(result, found):
        console.print(line)


def _cells(point: Point) -> tuple[str, ...]:
    low, high = point.detection_interval
    fewest, most = point.false_interval
    announced = "-"
    if point.lumps:
        announced = f"{point.announced}/{point.lumps} ({100 * low:.0f}-{100 * high:.0f} %)"
    rate = "-"
    if point.false_per_hour is not None:
        rate = f"{_rate(point.false_per_hour)} ({_rate(fewest)}-{_rate(most)})"
    return (
        f"{point.raise_above:g}",
        announced,
        f"{_seconds(point.warning_median_s)}|{_seconds(point.warning_worst_tenth_s)}",
        rate,
        str(point.true_alarms),
        str(point.misplaced_alarms),
    )


def _why_none(result: Result, wanted: float) -> str:
    most = result.recommendation.most_announced
    return {
        "no_lumps": "no labelled lump counts in these videos. Give some with lumps; the table holds false alarms "
        "alone.",
        "too_many_false": f"none keeps to {wanted:g} false alarms an hour. Train on this footage (--without-lumps), "
        "raise detector.likelihood.margin, or want less.",
        "nothing_announced": f"where false alarms keep to {wanted:g} an hour no lump is announced in time; the most "
        f"at any threshold is {most}. Train on footage like this before choosing one.",
    }[result.recommendation.reason or "too_many_false"]


def _rate(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _time(hours: float) -> str:
    """Hours as people say them."""
    minutes = round(60 * hours)
    return (
        f"{60 * hours:.1f} min" if minutes < 10 else f"{minutes} min" if minutes < 120 else f"{hours:.1f} h"
    )


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _words(result: Result, found: Backtest) -> list[str]:
    """What the table does not say."""
    advice, wanted = result.recommendation, found.terms.false_alarms_per_hour
    last = result.points[-1]
    lumps = [lump for video in result.judged for lump in video.truth.lumps]
    counted = [lump for lump in lumps if lump.counted]
    by_fall = sum(lump.lip_from == "fall label" for lump in counted)
    outside = sum(video.truth.outside for video in result.judged)
    lost = sum(video.recording.length - len(video.recording.frames) for video in result.judged)
    lines = [
        f"{_time(found.hours)} of footage, {_time(last.quiet_h)} of it without a lump. In brackets: 95 % "
        f"intervals. Announced: at least {found.terms.least_warning_s:g} s before the lip. Warning: median | "
        "worst tenth, 0 for a lump without any. True, misplaced: alarms raised while a lump was there, with and "
        "without the box on it. config.: the threshold of the configuration; advised: the recommended one.",
        f"Lip: {by_fall} lumps by the label of the fall, {len(counted) - by_fall} by their last label. Not "
        f"counted: {len(lumps) - len(counted)} lumps cut off by the video, {outside} labelled outside the ROI.",
    ]
    if advice.point is None:
        lines.append(f"There is no threshold to recommend: {_why_none(result, wanted)}")
    else:
        lines.append(
            f"Recommended for at most {wanted:g} false alarms an hour: raise_above {advice.point.raise_above:g}, "
            f"clear_below {advice.point.clear_below:.3g}. It announces {advice.point.announced} of "
            f"{last.lumps} lumps; the most at any threshold is {advice.most_announced}. An alarm stands for "
            f"{advice.point.standing_share:.2%} of the time without a lump."
        )
    if advice.point is not None and advice.below_per_hour > wanted:
        lines.append(
            f"The footage is too short to show that rate: {advice.point.false_alarms} false alarms in "
            f"{_time(last.quiet_h)} only prove fewer than {_rate(advice.below_per_hour)} an hour (95 % sure); "
            f"{wanted:g} takes {advice.needed_h:.0f} hours without any."
        )
    if result.refused:
        lines.append(f"The prior did not fit {result.refused} videos: they ran on the stated defaults.")
    if lost:
        lines.append(f"{lost} frames could not be judged.")
    return lines
