"""The page of the background experiment: every figure in it is computed."""

from __future__ import annotations

import numpy as np

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground
from tests.reproduction.paper3_background.measure import LEAST_AREA, Score
from tests.reproduction.paper3_background.methods import OURS, PAPER, contrib_python
from tests.reproduction.paper3_background.scenes import (
    ABSORBED_WITHIN,
    FPS,
    HEIGHT,
    NOISE,
    STILL_FOREGROUND,
    TRAINING,
    WIDTH,
)

Scores = dict[str, dict[str, list[tuple[Score, Score]]]]
EVENTS = {
    "plain": "nothing but noise and objects",
    "waving": "foliage waves in two fifths of the picture, in gusts",
    "gradual": "light falls to 60 % within ten seconds and rises again",
    "sudden": "a light goes on: 40 % brighter at once",
    "stopped": "an object stops for 25 s and leaves; others pass",
    "shadows": "objects cast shadows that take 40 % of the light; shadows count as background",
}
GOALS = ("waving", "sudden", "stopped")


def write(
    scores: Scores, times: dict[int, dict[str, tuple[float, float]]], has_highway: bool, seeds: int
) -> str:
    """The page as Markdown."""
    parts = [
        "<!-- Written by `python -m tests.reproduction background`. -->",
        "# The background model beside others",
        _method(seeds),
        "## F1 by event",
        _f1_table(scores),
        "![A frame of each scene](../images/background_scenes.png)",
        "## The goal: better than MOG2 on waving and once-off scenes",
        _verdicts(scores),
        "## Precision and recall",
        _precision_table(scores),
        "## Once-off changes",
        _absorbed_table(scores),
        "## Time",
        _time_table(times),
        "## Real cars",
        "![A motorway](../images/background_highway.png)\n\nThere is no truth for these pictures: they are to look at."
        if has_highway
        else "**Left out, because the footage is not here.**",
    ]
    return "\n\n".join(parts) + "\n"


def _method(seeds: int) -> str:
    o = BackgroundOptions()
    left_out = (
        ""
        if contrib_python()
        else "\n\n**CNT, GSOC and LSBP are left out: LUMPWATCH_CONTRIB_PYTHON names no interpreter with them.**"
    )
    return f"""Generated scenes of {WIDTH} x {HEIGHT} at {FPS} frames a second with camera noise of {NOISE:g} grey
levels and truth for every pixel. Textured objects cross, one every 1 to 2.5 seconds. The first {TRAINING} frames
show no objects and are not judged (ours takes the first {o.initial_frames} for background whatever they show). Every
method has its library's defaults in all scenes; pixels that MOG2 and KNN call shadow are not counted as
foreground. Ours removes regions below {o.least_area} pixels itself, the others do not; *cleaned* is F1 after the same
removal (below {LEAST_AREA} pixels) for all. Figures are means over {seeds} seeds of each scene. The defaults of ours
were chosen with scenes of the same kinds and other seeds in view, and so was the rule of which a pixel that
moved is asked; the others were not tuned, so that this page favours ours.

An object that stops is foreground for {STILL_FOREGROUND / FPS:g} s and background after
{ABSORBED_WITHIN / FPS:g} s; between the two it is not judged. What it uncovers when it leaves is background at once.

*{PAPER}*: `rule="paper"`, `once_off="swap"`, `noise_floor=0`, `learn_every=1`, `darkest_shadow=1`.{left_out}"""


def _mean(pairs: list[tuple[Score, Score]], which: int, figure: str) -> float:
    return float(np.mean([getattr(pair[which], figure) for pair in pairs]))


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _f1_table(scores: Scores) -> str:
    methods = list(next(iter(scores.values())))
    rows = []
    for name, by_method in scores.items():
        cells = []
        best = max(_mean(pairs, 0, "f1") for pairs in by_method.values())
        for method in methods:
            raw, clean = _mean(by_method[method], 0, "f1"), _mean(by_method[method], 1, "f1")
            text = f"{raw:.3f}" if raw < best else f"**{raw:.3f}**"
            cells.append(text if method in (OURS, PAPER) else f"{text} ({clean:.3f})")
        rows.append([f"{name}: {EVENTS[name]}", *cells])
    return "The best is bold; in brackets F1 cleaned.\n\n" + _table(["scene", *methods], rows)


def _verdicts(scores: Scores) -> str:
    lines = []
    for name, by_method in scores.items():
        ours = np.array([pair[0].f1 for pair in by_method[OURS]])
        others = [np.array([pair[which].f1 for pair in by_method["MOG2"]]) for which in (0, 1)]
        gaps = [ours - other for other in others]
        words = ["better" if gap.mean() > 0 else "worse" for gap in gaps]
        seeds = [int((gap > 0).sum()) for gap in gaps]
        goal = " (part of the goal)" if name in GOALS else ""
        met = "" if name not in GOALS or gaps[0].mean() > 0 else " **The goal is missed here.**"
        lines.append(
            f"- {name}{goal}: {words[0]} than MOG2 by {abs(gaps[0].mean()):.3f} (on {seeds[0]} of {len(ours)} seeds), "
            f"{words[1]} than MOG2 cleaned by {abs(gaps[1].mean()):.3f} (on {seeds[1]}).{met}"
        )
    for name, by_method in scores.items():
        means = {method: _mean(pairs, 1, "f1") for method, pairs in by_method.items()}
        above = [method for method, f1 in means.items() if f1 > means[OURS] and method != OURS]
        if above:
            lines.append(
                f"- {name}: cleaned, {', '.join(above)} {'is' if len(above) == 1 else 'are'} better than ours."
            )
    return (
        "\n".join(lines)
        + "\n\n"
        + ("Of a shadow ours leaves out what has the colour of the place; MOG2 and KNN do the same.")
    )


def _precision_table(scores: Scores) -> str:
    methods = list(next(iter(scores.values())))
    rows = [
        [name, *(f"{_mean(p[m], 0, 'precision'):.2f} / {_mean(p[m], 0, 'recall'):.2f}" for m in methods)]
        for name, p in scores.items()
    ]
    return _table(["scene", *methods], rows)


def _absorbed_table(scores: Scores) -> str:
    methods = list(next(iter(scores.values())))
    rows = []
    for name, by_method in scores.items():
        for what in by_method[OURS][0][0].absorbed:
            cells = []
            for method in methods:
                frames = [pair[1].absorbed[what] for pair in by_method[method]]
                known = [frame for frame in frames if frame is not None]
                text = f"{np.median(known):.0f}" if known else "never"
                never = len(frames) - len(known)
                cells.append(text if not known or not never else f"{text}, never in {never} of {len(frames)}")
            rows.append([f"{name}: {what}", *cells])
    return (
        "Frames until less than a twentieth of the changed pixels is foreground, median over the seeds, cleaned masks. "
        "An object that is absorbed sooner is also lost sooner: for *stops* fewer frames are not better as such.\n\n"
        + _table(["change", *methods], rows)
    )


def _time_table(times: dict[int, dict[str, tuple[float, float]]]) -> str:
    rows = [
        [name, *(f"{times[threads][name][0]:.2f} ({times[threads][name][1]:.2f})" for threads in times)]
        for name in times[1]
    ]
    head = ["method", "1 thread, CPU time", "2 threads, wall clock"]
    ours = times[2][OURS][0]
    verdict = "met" if ours <= 5.0 else "**missed** in this run"
    model = StatisticalBackground()
    model.apply(np.zeros((240, 360, 3), np.uint8))
    size, each = model.nbytes / 2**20, model.nbytes / (240 * 360)
    slower = [times[threads][OURS][0] / times[threads]["MOG2"][0] for threads in (1, 2)]
    return (
        "Milliseconds a frame of 360 x 240 with foliage in two fifths of it, median and in brackets the lower decile "
        "over frames; CPU time on one thread, wall clock on two, which other work on the machine lengthens. "
        "The methods run one after the other. The paper needed 2 s.\n\n"
        + _table(head, rows)
        + f"\n\nThe goal of 5 ms on two cores is {verdict}: {ours:.2f} ms; that of 3 ms on one is "
        f"{'met' if times[1][OURS][0] <= 3.0 else '**missed**'}: {times[1][OURS][0]:.2f} ms of CPU time. "
        + f"Ours takes {slower[0]:.1f} times as long as "
        + f"MOG2 on one thread and {slower[1]:.1f} times on two. It holds {size:.0f} MiB ({each:.0f} bytes a pixel)."
    )
