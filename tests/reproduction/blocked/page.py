"""The page of figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tests.reproduction.blocked.run import ABOVE, DELAY_S
from tests.reproduction.blocked.scenes import BLOCKED, FPS, NORMAL, Scene

METHODS = ("lumpwatch", "frame difference", "MOG2")
Runs = dict[tuple[str, str], list[dict[str, Any]]]
_AFTER_S = 4.0
"""An alarm so soon after a blockage broke is still of it."""
_IN_TIME_S = DELAY_S + 2.0
_ASKED_HOURS = 10.0


@dataclass(frozen=True, slots=True)
class Case:
    """One blockage, and what a method made of it."""

    scene: str
    began_s: float
    """From the start of its feed."""
    took_s: float | None
    """From its begin to the alarm; 0 where the alarm of the one before still stood. None: not found."""
    known: bool
    """Whether the mouth was known when it began; until then the region is BLIND."""

    @property
    def late(self) -> bool:
        """Not found, or later than asked for."""
        return self.took_s is None or self.took_s > _IN_TIME_S + 1e-6


def page(runs: Runs, limits: dict[str, float]) -> str:
    """All of docs/results/blocked.md."""
    cases = [case for scene in BLOCKED for case in _cases(runs, scene, "lumpwatch")]
    known, unknown = [c for c in cases if c.known], [c for c in cases if not c.known]
    normal = [run for scene in NORMAL for run in runs["normal", scene.name]]
    hours = sum(run["seconds"] for run in normal) / 3600
    false = {method: sum(_false(run, method) for run in normal) for method in METHODS}
    beside = {
        method: sum(_false(run, method) for scene in BLOCKED for run in runs["blocked", scene.name])
        for method in METHODS
    }
    lines = [
        "# Blocked mouths",
        "",
        "How soon a bridged mouth is announced, and how often one that only swallows, on simulated feeds with truth. "
        "Written by `python -m tests.reproduction.blocked`; all rows are of one state of the code.",
        "",
        f"{len(cases)} blockages, and {hours:.2f} simulated hours of normal crushing. The configuration is the default "
        f"(`on_delay_s` {DELAY_S:g}), but that on the belt nobody asks whether a followed object stands "
        f"(`quality.hidden.standing`): it costs a third of the time. Pictures of 320 x 240, {FPS:g} a second.",
        "",
        f"- Blockages that began when the mouth was known: found **{_found(known)} of {len(known)}**, "
        f"{sum(not c.late for c in known)} of them within `on_delay_s` + 2 s, which is asked for of all.",
        f"- Blockages that began before it was known, within ten seconds of the feed's start, while the region says "
        f"BLIND (starting): found {_found(unknown)} of {len(unknown)}, {sum(not c.late for c in unknown)} in that "
        "time.",
        f"- False alarms in normal crushing: **{false['lumpwatch']}** in {hours:.2f} h; asked for is at most one in "
        + ("ten hours." if hours >= _ASKED_HOURS - 0.01 else "ten hours, which so short a run cannot show."),
        "",
        f"A blockage begins when material stands in {100 * ABOVE:.0f} % of the mouth while the feed runs, or when a "
        "lump comes to rest in it, and counts where the feed runs for four seconds longer than the delay meanwhile. "
        "It is found by an alarm that stands between its begin and its end.",
        "",
        "The whole pipeline runs (picture quality, feed state, mouth, alarm), but for the belt's filter: lumps are "
        "followed as the truth has them, so the figures are those of the mouth and not of the filter.",
        "",
        "## Blockages",
        "",
        "| scene | | blockages | " + " | ".join(f"{m}: found | median, worst s" for m in METHODS) + " |",
        "|---|---|--:|" + "--:|--:|" * len(METHODS),
        *(_blocked_row(scene, runs) for scene in BLOCKED),
        "",
        "Times are seconds from the begin of a blockage to the alarm; 0 where the alarm of the one before still stood. "
        "Those of `stops` hold the seconds in which the feed stood, which do not count for the alarm. In pictures of "
        "this size the mouth is 43 px high, five rows of windows.",
        "",
        *_late_ones(cases),
        "## Normal crushing",
        "",
        "| scene | | hours | " + " | ".join(f"{m}: false" for m in METHODS) + " | blind, s |",
        "|---|---|--:|" + "--:|" * len(METHODS) + "--:|",
        *(_normal_row(scene, runs) for scene in NORMAL),
        "",
        "Blind: how long the region could not judge; of each feed of five minutes the first ten seconds, in which the "
        "mouth is learned, are in it. False alarms beside the blockages of the table above: "
        + ", ".join(f"{method} {beside[method]}" for method in METHODS)
        + ".",
        "",
        "## The peers",
        "",
        "Both call a mouth blocked in which too little has moved for the delay while the feed runs, by the same feed "
        "state: frame difference (10 grey levels after a blur) and OpenCV's MOG2 (history 50). Their thresholds part a "
        "clip of bridges and normal crushing best, which is not in the tables: "
        + ", ".join(f"{name} {100 * limit:.1f} % of the mouth" for name, limit in limits.items())
        + ". They were told what lumpwatch has to find out: pictures with truth.",
        "",
    ]
    return "\n".join(lines)


def _cases(runs: Runs, scene: Scene, method: str) -> list[Case]:
    return [
        Case(scene.name, a, _took(run, method, a, b), a >= run["known_s"])
        for run in runs["blocked", scene.name]
        for (a, b), ran_s in zip(run["blocked"], run["ran_s"], strict=True)
        if ran_s >= DELAY_S + 4.0 - 1.0 / FPS
    ]


def _took(run: dict[str, Any], method: str, a: float, b: float) -> float | None:
    return next(
        (max(since - a, 0.0) for since, until in run["said"][method] if since <= b + 1.0 and until > a), None
    )


def _found(cases: list[Case]) -> int:
    return sum(case.took_s is not None for case in cases)


def _false(run: dict[str, Any], method: str) -> int:
    """Alarms outside of everything that stood."""
    return sum(
        not any(a - 1.0 <= t <= b + _AFTER_S for a, b in run["blocked"]) for t in run["raised"][method]
    )


def _blocked_row(scene: Scene, runs: Runs) -> str:
    cells = []
    for method in METHODS:
        told = sorted(case.took_s for case in _cases(runs, scene, method) if case.took_s is not None)
        cells += [f"{len(told)}", f"{told[len(told) // 2]:.1f}, {told[-1]:.1f}" if told else "none"]
    count = len(_cases(runs, scene, METHODS[0]))
    return f"| {scene.name} | {scene.about} | {count or 'not run'} | " + " | ".join(cells) + " |"


def _late_ones(cases: list[Case]) -> list[str]:
    late = [case for case in cases if case.late]
    if not late:
        return []
    return [
        f"Not found, or later than {_IN_TIME_S:g} s:",
        "",
        "| scene | began, s from the feed's start | mouth known | announced after, s |",
        "|---|--:|---|--:|",
        *(
            f"| {case.scene} | {case.began_s:.1f} | {'yes' if case.known else 'no'} | "
            f"{'never' if case.took_s is None else f'{case.took_s:.1f}'} |"
            for case in late
        ),
        "",
    ]


def _normal_row(scene: Scene, runs: Runs) -> str:
    some = runs["normal", scene.name]
    hours = sum(one["seconds"] for one in some) / 3600
    cells = [str(sum(_false(one, method) for one in some)) for method in METHODS]
    blind = sum(one["blind_s"] for one in some)
    return f"| {scene.name} | {scene.about} | {hours:.2f} | " + " | ".join(cells) + f" | {blind:.0f} |"
