"""The page of the experiments: every figure in it is computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from docs.experiments.traffic.scene import FRAMES, LEARNING, RATE
from tests.reproduction.paper3_jpda.peers import Comparison
from tests.reproduction.paper3_jpda.simulation import LOST, METHODS, PAPER, Score, Setting
from tests.reproduction.paper3_jpda.system import LEAST_AREA, OVERLAP, SETTLING_S, VISIBLE, Outcome

Simulated = dict[Setting, dict[str, list[Score]]]
Compared = list[tuple[Setting, list[Comparison]]]
Whole = dict[str, dict[str, Outcome]]
"""Of each scene, of each foreground."""
BUSY = 8


def write(simulated: Simulated, compared: Compared, whole: Whole, variants: dict[str, Outcome]) -> str:
    """The page as Markdown."""
    seeds = len(next(iter(simulated[PAPER].values())))
    parts = [
        "<!-- Written by `make reproduce`. -->",
        "# Joint probabilistic data association: the experiments of paper 3",
        "`.venv/bin/python -m tests.reproduction jpda` writes this page. Generated scenes; the paper's own "
        "sequences are not public.",
        "## Goals",
        _goals(compared, whole),
        "## The paper's simulation",
        _simulation_text(seeds),
        "![Simulation](../images/jpda_simulation.png)",
        _simulation_table(simulated),
        "![Over clutter and detection](../images/jpda_curves.png)",
        _simulation_reading(simulated),
        "## Beside Stone Soup",
        _peers(compared),
        "## The whole system on generated traffic",
        _traffic_text(whole),
        "![Traffic](../images/jpda_traffic.png)",
    ]
    for scene, outcomes in whole.items():
        parts += [f"### {scene[0].upper()}{scene[1:]}", _detection_table(outcomes), _tracks_table(outcomes)]
        parts += [_time_table(outcomes)]
    parts += [
        "## What the parts are worth",
        f"MOG2 in the place of the background model, {next(iter(whole))}.",
        _tracks_table(variants),
    ]
    return "\n\n".join(parts) + "\n"


def rate(outcome: Outcome, busy: bool) -> float:
    """Pictures a second; `busy`: from those with eight objects or more."""
    chosen = np.array(outcome.busy) >= (BUSY if busy else 0)
    total = sum(
        np.array(part)[chosen] for part in (outcome.foreground_s, outcome.regions_s, outcome.tracker_s)
    )
    return float(1.0 / np.mean(total))


def _goals(compared: Compared, whole: Whole) -> str:
    agreement = [c.difference for _, comparisons in compared for c in comparisons if c.name == "JPDA"]
    lines = []
    if agreement:
        met = _met(max(agreement) <= 1e-9)
        lines += [
            f"Marginals agree with Stone Soup's exact ones to {max(agreement):.1e} (goal 1e-9): {met}.",
            "",
        ]
    columns = [next(iter(outcomes.items())) for outcomes in whole.values()]
    lines += [
        f"The whole system with the {columns[0][0]}:",
        "",
        f"| | goal | {' | '.join(whole)} |",
        "|" + "---|" * (len(whole) + 2),
    ]
    rows: tuple[tuple[str, float, int, Callable[[Outcome], float]], ...] = (
        ("precision of the tracked boxes", 0.99, 4, lambda o: o.tracked.precision),
        ("recall of the tracked boxes", 0.90, 4, lambda o: o.tracked.recall),
        (f"precision of the regions, overlap {OVERLAP:g}", 0.99, 4, lambda o: o.regions.precision),
        ("precision of the regions as the paper counts it", 0.99, 4, lambda o: o.regions.on_objects),
        ("recall of the regions", 0.90, 4, lambda o: o.regions.recall),
        (f"pictures a second at {BUSY} objects or more", 60.0, 0, lambda o: rate(o, busy=True)),
    )
    for what, goal, digits, value in rows:
        cells = [f"{value(o):.{digits}f} ({_met(value(o) >= goal)})" for _, o in columns]
        lines.append(f"| {what} | >= {goal:g} | {' | '.join(cells)} |")
    found = [f"{o.found} of {o.wrong_way} ({_met(o.found == o.wrong_way)})" for _, o in columns]
    falsely = [f"{o.falsely} ({_met(o.falsely == 0)})" for _, o in columns]
    lines.append(f"| wrong-way riders flagged | all | {' | '.join(found)} |")
    lines.append(f"| right-way objects flagged | 0 | {' | '.join(falsely)} |")
    lines += [
        "",
        f"Regions are counted before the tracker cuts them: objects that touch are one region, which overlaps neither "
        f"by {OVERLAP:g}, so that each such region is one false and two missed. The tracker's boxes are what the "
        "alarm sees.",
    ]
    return "\n".join(lines)


def _met(met: bool) -> str:
    return "met" if met else "**missed**"


def _simulation_text(seeds: int) -> str:
    return f"""Eight targets, 100 steps, starts in [0..500] x [0..50], false alarms uniform in [0..200] x [0..200],
P_D = {PAPER.detection:g}; {seeds} seeds. The paper does not give its clutter rate, motion and noise: {PAPER.clutter}
false alarms a step, velocities of up to 0.5 (x) and 1 to 2 (y) px a step with white-noise acceleration, and 2 px of
measurement noise stand in for them. *Dense* scenes start all targets inside the false alarms' area; in *crossing*
ones they meet in pairs at an angle of 6 to 20 degrees. All methods have the same Kalman filter, the same gate,
and the true number of targets and first positions, as in the paper; they differ in the association alone.
*Tracked right through*: never more than {LOST:g} px from its own estimate. *Ids switched*: changes of
the estimate that is nearest to a target (assigned jointly), per target."""


def _simulation_table(simulated: Simulated) -> str:
    lines = [
        "Per cent tracked right through / median error of those (px) / ids switched per target; means over seeds.",
        "",
        f"| scene | {' | '.join(METHODS)} |",
        "|" + "---|" * (len(METHODS) + 1),
    ]
    for setting, methods in simulated.items():
        cells = [
            f"{100 * np.mean([s.held for s in scores]):.1f} / {np.nanmean([s.error for s in scores]):.2f} / "
            f"{np.mean([s.switches for s in scores]):.2f}"
            for scores in methods.values()
        ]
        lines.append(f"| {setting.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _simulation_reading(simulated: Simulated) -> str:
    """Paired comparison of the exact association with the others, in words."""
    lines = [
        "Targets tracked right through, JPDA* (the default) less the other, points; 95 % interval of the paired mean:",
        "",
    ]
    ours, *others = METHODS
    verdicts: dict[str, list[str]] = {other: [] for other in others}
    lines += [f"| scene | {' | '.join(others)} |", "|" + "---|" * (len(others) + 1)]
    for setting, methods in simulated.items():
        cells = []
        for other in others:
            gap = 100.0 * np.array(
                [a.held - b.held for a, b in zip(methods[ours], methods[other], strict=True)]
            )
            reach = 1.96 * gap.std(ddof=1) / np.sqrt(len(gap))
            word = "better" if gap.mean() > reach else "**worse**" if gap.mean() < -reach else "no difference"
            verdicts[other].append(word)
            cells.append(f"{gap.mean():+.1f} ± {reach:.1f} ({word})")
        lines.append(f"| {setting.name} | {' | '.join(cells)} |")
    lines.append("")
    for other, words in verdicts.items():
        better, worse = words.count("better"), words.count("**worse**")
        lines.append(f"- Against {other}: better in {better} of {len(words)} scenes, worse in {worse}.")
    lines += [
        "",
        "The mean over all pairings draws targets that stay close towards each other (coalescence): exact JPDA "
        "switches ids there more often than a hard assignment. JPDA* keeps the most probable permutation alone.",
    ]
    return "\n".join(lines)


def _peers(compared: Compared) -> str:
    if not any(comparisons for _, comparisons in compared):
        return "**Not measured: Stone Soup is not installed (`make bench` installs it).**"
    lines = [
        "The same predicted targets and scans; Stone Soup's hypotheses are made beforehand, so that the "
        "association alone is timed, situation by situation in turn. Its exact associator enumerates all "
        "combinations: situations with more than some twenty thousand are left out, those with most shared "
        "measurements are chosen.",
        "",
        "| scene | Stone Soup's | situations | largest difference of a marginal | its time over ours (median) |",
        "|---|---|---|---|---|",
    ]
    for setting, comparisons in compared:
        lines += [
            f"| {setting.name} | `{c.name}` | {c.situations} | {c.difference:.1e} | {c.ratio:.0f} |"
            for c in comparisons
        ]
    lines += [
        "",
        "`JPDAwithLBP` stops its iteration by a looser rule than ours; both approximate the same fixed point.",
    ]
    return "\n".join(lines)


def _traffic_text(whole: Whole) -> str:
    busy = [count for outcomes in whole.values() for count in next(iter(outcomes.values())).busy]
    seconds = (FRAMES - LEARNING) / RATE
    sequences = round(len(busy) / len(whole) / (FRAMES - LEARNING))
    return f"""{sequences} sequences of {seconds:g} s and {LEARNING} pictures more for learning, 360 x 240 pixels,
{RATE:g} a second, {np.mean(busy):.1f} objects at a time on average and {max(busy)} at most: motorcycles and cars on a
textured road with noise and drifting light, in two streams, with riders against the direction between the lanes
and others that overtake so closely that they touch. Either the road is
empty while the background is learned, or only in the first picture: the model takes all that it sees in that time for
background, vehicles too. Options were chosen on sequences of other seeds.

A box is right where its overlap (intersection over union) with a true one, cut to the picture, is {OVERLAP:g} or
more, one to one; objects of which less than {VISIBLE:g} is in the picture count neither way. *Regions* are the
foreground's connected components of at least {LEAST_AREA} pixels; *tracked boxes* are those of confirmed tracks.
*On objects* is the precision as the paper counts it, where only background taken for an object is
false: the share of regions at least half of which lies on true objects. A track is *fully right* if one and the
same track has the object in every frame, from {SETTLING_S:g} s after it comes into view. A rider is *found*
if it is flagged while in view; a flag is *false* on a track that never lay on a wrong-way rider."""


def _detection_table(whole: dict[str, Outcome]) -> str:
    lines = [
        "| foreground | boxes | precision | on objects | recall |",
        "|---|---|---|---|---|",
    ]
    for name, outcome in whole.items():
        for kind, counts in (("regions", outcome.regions), ("tracked boxes", outcome.tracked)):
            lines.append(
                f"| {name} | {kind} | {counts.precision:.4f} | {counts.on_objects:.4f} | {counts.recall:.4f} |"
            )
    return "\n".join(lines)


def _tracks_table(outcomes: dict[str, Outcome]) -> str:
    lines = [
        "| | objects | fully right | ids switched | tracked precision | tracked recall "
        "| wrong-way found | falsely flagged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, o in outcomes.items():
        lines.append(
            f"| {name} | {o.objects} | {o.right} ({100 * o.right / max(o.objects, 1):.1f} %) | {o.switches} | "
            f"{o.tracked.precision:.4f} | {o.tracked.recall:.4f} | {o.found} of {o.wrong_way} | {o.falsely} |"
        )
    return "\n".join(lines)


def _time_table(whole: dict[str, Outcome]) -> str:
    main = rate(next(iter(whole.values())), busy=True)
    lines = [
        "Time of all pictures after learning, both in turn in one run, two threads. The paper needed 2 s a picture.",
        "",
        "| foreground | foreground (ms) | regions (ms) | tracker (ms) | pictures/s "
        f"| at {BUSY} objects or more | ratio to the first |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, o in whole.items():
        parts = " | ".join(
            f"{1e3 * np.mean(part):.2f}" for part in (o.foreground_s, o.regions_s, o.tracker_s)
        )
        each, busy = rate(o, busy=False), rate(o, busy=True)
        lines.append(f"| {name} | {parts} | {each:.0f} | {busy:.0f} | {busy / main:.2f} |")
    return "\n".join(lines)
