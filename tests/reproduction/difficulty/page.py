"""The page about the matrix of difficulty, written from the figures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lumpwatch.models.intervals import binomial_interval, poisson_interval
from tests.reproduction import matrix
from tests.reproduction.difficulty import plots
from tests.reproduction.difficulty.judge import (
    LEVEL,
    MOST_STANDING,
    TERMS,
    WANTED_PER_HOUR,
    Cell,
    chance,
    paired,
    title,
)
from tests.reproduction.difficulty.peers import ALARM, OURS, PEERS
from tests.reproduction.difficulty.results import Results, StyleResult, total
from tests.reproduction.difficulty.sizes import Stated

_NOT_RUN = "*Not run yet.*"


def write(found: Results) -> str:
    """The page."""
    return f"""<!-- Written by `make reproduce`. -->

# The matrix of difficulty

The lump filter and what one might take in its place, on the same frames of the [simulated feed](../simulator.md)
and with the same labels. Every method is trained on one minute of the standard scene of each style (eight
lumps), and on no other scene; the likelihood of the first four starts, as the product's training always does,
from the shipped one, which has seen simulated lumps of all kinds in all weathers (other seeds:
`tests/reproduction/defaults.py`). All know the calibration of the belt and the limit, and ask for the sizes that
follow from it; the settings of MOG2 and of the trackers were chosen before, with the sizes of the labels, and may
not be their best here. A lump below the limit (scenes size-0.85 and size-0.70) is none here: an alarm for it is false.

| method | what it is |
|---|---|
| {PEERS[OURS].title} | `kind: jdt` with the stated defaults |
| {PEERS["fixed"].title} | the same, `switching: fixed` |
| {PEERS["single"].title} | the same with one motion model, the belt's |
| {PEERS["map"].title} | the likelihood at all boxes that lumps may have at each row; the alarm judges its maximum |
| {PEERS["mog2"].title} | background subtraction; the largest blob that is no larger than lumps are at its row |
| {PEERS["jpda"].title} | `kind: jpda`, foreground by mixture |
| {PEERS["imm_pf"].title} | `kind: imm_pf`, foreground by mixture |

A lump is *found* when an alarm stands, with a box on the lump, {TERMS.least_warning_s:g} s before its fall begins or
earlier. An alarm is *false* when no lump was there at its raise, nor came or went within {TERMS.tolerance_s:g} s.
Delays of the alarm are the same for all. Each method has its own best threshold for each style: the one
that finds most lumps of the training feeds at no more than {WANTED_PER_HOUR:g} false alarms an hour and with the
alarm standing for no more than {MOST_STANDING:.0%} of the time without lumps. Ours has more training feeds to choose
it on, among them {found.plan.choose_long} of {found.plan.long_s / 60:g} minutes without lumps for each style: the
others have seen less, and choose lower thresholds, which find more. Seeds of training and of test have no
number in common. Made by `python -m tests.reproduction difficulty`.

## The standard scenes

{_standard(found)}

## The long run without lumps

{_long(found)}

## Every scene

{_matrix(found)}

## Where ours is not the best

{_behind(found)}

## Sizes

{_sizes(found)}

## Time a frame

{_time(found)}
"""


def _standard(found: Results) -> str:
    if not found.styles:
        return _NOT_RUN
    parts = [
        "Lumps of 1.2 to 2 times the limit, moderate dust. Lines: all thresholds on the test feeds; rings: the\n"
        "threshold that was chosen on the training feeds; dotted: the false alarms it might cost there.\n\n"
        f"![Lumps found against false alarms](../images/{plots.CURVES})"
    ]
    for style, result in found.styles.items():
        with_lumps, empty = result.testing
        rows = "\n".join(_standard_row(key, result) for key in result.tested)
        parts.append(
            f"Style {style}: {with_lumps} test feeds with lumps, of which the peers saw "
            f"{min(with_lumps, found.plan.peer_lumps)}, and {empty} without, each of {found.plan.seconds:g} s; "
            f"thresholds from {result.choosing[0]} and\n{result.choosing[1]} training feeds.\n\n"
            "| method | threshold | lumps | found | share (95 % interval) | median warning (s) | worst tenth (s) "
            "| false alarms an hour (95 % interval) |\n|---|---|---|---|---|---|---|---|\n" + rows
        )
    parts.append(f"![Warning times](../images/{plots.WARNINGS})")
    return "\n\n".join(parts)


def _standard_row(key: str, result: StyleResult) -> str:
    cell, lumps = result.tested[key], len(result.tested[key].found)
    low, high = binomial_interval(sum(cell.found), lumps)
    share = f"{np.mean(cell.found):.1%} ({low:.1%} to {high:.1%})" if lumps else "-"
    median, worst = _warnings(cell)
    return (
        f"| {title(key)} | {result.chosen[key].raise_above:g} | {lumps} | {sum(cell.found)} "
        f"| {share} | {median} | {worst} | {_rate(cell)} |"
    )


def _warnings(cell: Cell) -> tuple[str, str]:
    """Median and worst tenth, 0 for a lump without warning."""
    if not cell.warnings_s:
        return "-", "-"
    worst = np.quantile(cell.warnings_s, 0.1, method="lower")
    return f"{np.median(cell.warnings_s):.1f}", f"{worst:.1f}"


def _rate(cell: Cell) -> str:
    low, high = poisson_interval(cell.false_alarms, cell.quiet_h)
    return f"{cell.per_hour:.1f} ({low:.1f} to {high:.1f})"


def _long(found: Results) -> str:
    results = {style: result for style, result in found.styles.items() if result.long}
    if not results:
        return _NOT_RUN
    rows = [
        f"| {style} | {_named(result, raise_above)} | {cell.quiet_h:.1f} | {cell.false_alarms} | "
        f"{cell.per_hour:.2f} | {low:.2f} to {high:.2f} | {_found_at(result, raise_above)} |"
        for style, result in results.items()
        for (_, raise_above), cell in result.long.items()
        for low, high in [poisson_interval(cell.false_alarms, cell.quiet_h)]
    ]
    hours = sum(next(iter(result.long.values())).quiet_h for result in results.values())
    return (
        f"{hours:.1f} simulated hours of the standard scenes with medium rocks and dust as usual, and no lump;\n"
        "ours, at several thresholds, beside the lumps of the test feeds that it finds at the same one.\n\n"
        "| style | threshold | hours | false alarms | an hour | 95 % interval | lumps found |\n"
        "|---|---|---|---|---|---|---|\n" + "\n".join(rows)
    )


def _named(result: StyleResult, raise_above: float) -> str:
    names = [
        name
        for name, value in (("chosen", result.chosen[OURS].raise_above), ("default", ALARM.raise_above))
        if value == raise_above
    ]
    return f"{raise_above:g}" + (f" ({', '.join(names)})" if names else "")


def _found_at(result: StyleResult, raise_above: float) -> str:
    point = next(point for point in result.curves[OURS] if point.raise_above == raise_above)
    return f"{point.announced} of {point.lumps}"


def _matrix(found: Results) -> str:
    if not found.matrix:
        return _NOT_RUN
    keys = list(found.plan.peers)
    head = "| scene | lumps | " + " | ".join(PEERS[key].title for key in keys) + " |"
    rows = [
        f"| {name} | {len(row[OURS].found)} | " + " | ".join(_short(row[key]) for key in keys) + " |"
        for name, row in found.matrix.items()
    ]
    sums = {key: total(found.matrix, key) for key in keys}
    rows.append(
        f"| **all** | {len(sums[OURS].found)} | " + " | ".join(_short(sums[key]) for key in keys) + " |"
    )
    quiet = ", ".join(f"{PEERS[key].title} {sums[key].per_hour:.1f}" for key in keys)
    every = sum(1 for _ in matrix.scenes())
    watched = (
        f"**{len(found.matrix)} of {every} scenes have been watched.** " if len(found.matrix) < every else ""
    )
    return (
        f"![Lumps found and false alarms, scene by method](../images/{plots.HEAT})\n\n{watched}"
        "Lumps found, and in brackets false alarms, each method at its best threshold of the style's standard\n"
        "scene.\n\n"
        f"{head}\n|---|---|{'---|' * len(keys)}\n"
        + "\n".join(rows)
        + f"\n\nFalse alarms an hour over all scenes: {quiet}.\n\n"
        + _matrix_warnings(found)
    )


def _matrix_warnings(found: Results) -> str:
    keys = list(found.plan.peers)
    rows = []
    for name, row in found.matrix.items():
        cells = " | ".join(" / ".join(_warnings(row[key])) for key in keys)
        rows.append(f"| {name} | {cells} |")
    head = "| scene | " + " | ".join(PEERS[key].title for key in keys) + " |"
    return (
        "Warning times, median / worst tenth in seconds; a lump without any warning counts as 0:\n\n"
        f"{head}\n|---|{'---|' * len(keys)}\n" + "\n".join(rows)
    )


def _short(cell: Cell) -> str:
    return f"{sum(cell.found)} ({cell.false_alarms})"


def _behind(found: Results) -> str:
    if not found.matrix:
        return _NOT_RUN
    others = [key for key in found.plan.peers if key != OURS]
    surely, traded, perhaps = [], [], []
    tests = 2 * len(found.matrix) * len(others)
    for name, row in found.matrix.items():
        for key in others:
            one, ours, theirs = paired(row[OURS], row[key]), row[OURS], row[key]
            text = (
                f"{name}, {PEERS[key].title}: {sum(theirs.found)} against {sum(ours.found)} of "
                f"{len(ours.found)} lumps, {theirs.false_alarms} against {ours.false_alarms} false alarms"
            )
            if one.more_found and one.more_false:
                traded.append(text)
            elif one.fewer_found or one.more_false:
                surely.append(text)
            elif sum(theirs.found) > sum(ours.found):
                perhaps.append(text)
    return "\n\n".join(
        [
            "Compared lump by lump on the same frames: of the lumps that only one of two methods found, the exact\n"
            "sign test (McNemar's), and the same of their false alarms. A difference counts where chance explains it\n"
            f"with less than {LEVEL:.0%}: four lumps are none. Of {tests} tests up to {LEVEL * tests:.0f} would "
            "look like one\nby chance alone.",
            _list("Ours is **not at least as good** (peer against ours) at:", surely)
            or "**At no scene does a peer find more lumps, or as many with fewer false alarms, than chance explains.**",
            *filter(
                None, [_list("Ours found more lumps, but at the price of more false alarms, at:", traded)]
            ),
            _list("A peer found more, by so few that chance explains it, at:", perhaps)
            or "At no scene did a peer find more lumps at all.",
            "Over all scenes together:\n\n" + "\n".join(_overall(found, others)),
        ]
    )


def _list(head: str, items: list[str]) -> str:
    return head + "\n\n" + "\n".join(f"- {item}" for item in items) if items else ""


def _overall(found: Results, others: list[str]) -> Iterator[str]:
    yield "| peer | lumps that only ours found | only the peer | P by chance | false alarms: ours | peer |"
    yield "|---|---|---|---|---|---|"
    ours = total(found.matrix, OURS)
    for key in others:
        one = paired(ours, total(found.matrix, key))
        fewer, more = sorted((one.only_ours, one.only_theirs))
        p = min(1.0, 2.0 * chance(fewer, more))
        yield (
            f"| {PEERS[key].title} | {one.only_ours} | {one.only_theirs} | {_p(p)} "
            f"| {one.our_false} | {one.their_false} |"
        )


def _p(p: float) -> str:
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def _sizes(found: Results) -> str:
    results = {style: one.sizes for style, one in found.styles.items() if one.sizes is not None}
    if not results:
        return _NOT_RUN
    rows = [
        _size_row(style, moment, stated)
        for style, one in results.items()
        for moment, stated in (("alarm", one.at_alarm), ("track", one.on_track))
    ]
    return (
        "The longest diameter that is stated of a lump, with a calibration of four points clicked to the pixel.\n"
        "*Alarm*: once a lump, at the first frame at which the alarm stood with the estimate on it. *Track*: every\n"
        "frame before the lip with an estimate on a lump; neighbouring frames repeat each other, so there is no\n"
        "interval. In style a the truth is the diameter of the outline, in style b of the body in space.\n\n"
        "| style | moment | lumps or frames | with a size | median absolute error | median error "
        "| middle 80 % of the errors | truth in the stated 90 % interval |\n|---|---|---|---|---|---|---|---|\n"
        + "\n".join(rows)
        + f"\n\n![Stated against true size](../images/{plots.SIZES})"
    )


def _size_row(style: str, moment: str, stated: Stated) -> str:
    n, known = len(stated.true_mm), int(stated.known.sum())
    if not known:
        return f"| {style} | {moment} | {n} | 0 | - | - | - | - |"
    errors = stated.errors
    low, high = np.quantile(errors, (0.1, 0.9))
    held = f"{stated.held / known:.0%}"
    if moment == "alarm":
        held += " ({:.0%} to {:.0%})".format(*binomial_interval(stated.held, known))
    return (
        f"| {style} | {moment} | {n} | {known} | {np.median(np.abs(errors)):.1%} | {np.median(errors):+.1%} "
        f"| {low:+.0%} to {high:+.0%} | {held} |"
    )


def _time(found: Results) -> str:
    if not found.frame_ms:
        return _NOT_RUN
    mog2 = found.frame_ms["mog2"]
    rows = [f"| {PEERS[key].title} | {ms / mog2:.1f} |" for key, ms in found.frame_ms.items()]
    return (
        "CPU time of a frame on one thread, from the cut of the region to the estimate, median over the same\n"
        f"frames in the same processes, as a multiple of MOG2's ({mog2:.1f} ms here, with its smoothing and its\n"
        "blobs: the settings that find most are not the fastest ones).\n\n"
        "| method | times MOG2 |\n|---|---|\n" + "\n".join(rows)
    )
