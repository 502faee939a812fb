"""The page of figures."""

from __future__ import annotations

from typing import Any

from tests.reproduction.blocked.run import ABOVE, DELAY_S
from tests.reproduction.blocked.scenes import BLOCKED, FPS, NORMAL, Scene

METHODS = ("lumpwatch", "frame difference", "MOG2")
Runs = dict[tuple[str, str], list[dict[str, Any]]]
_AFTER_S = 4.0
"""An alarm so soon after a blockage broke is still of it."""


def page(runs: Runs, limits: dict[str, float]) -> str:
    """All of docs/results/blocked.md."""
    found = {method: _sum(runs, method) for method in METHODS}
    own = found["lumpwatch"]
    hours = sum(run["seconds"] for (kind, _), some in runs.items() if kind == "normal" for run in some) / 3600
    late = f"{100 * own['late'] / max(own['found'], 1):.0f} %"
    lines = [
        "# Blocked mouths",
        "",
        "How soon a bridged mouth is announced, and how often one that only swallows, on "
        "simulated feeds with truth. "
        "Written by `python -m tests.reproduction.blocked`.",
        "",
        f"{own['blockages']} blockages, and {hours:.2f} simulated hours of normal crushing. All keys of the "
        f"configuration are the defaults (`on_delay_s` {DELAY_S:g}); pictures of 320 x 240, {FPS:g} a second.",
        "",
        f"- Found: **{own['found']} of {own['blockages']}**; {own['late']} of them later than "
        f"`on_delay_s` + 2 s "
        f"({late}). The latest came {own['latest']:.1f} s after it had begun.",
        f"- False alarms in normal crushing: **{own['false']}** in {hours:.2f} h; asked for is "
        f"at most one in ten hours, "
        + ("which so short a run cannot show." if hours < 10 else "measured over as many."),
        "",
        f"A blockage begins when material stands in {100 * ABOVE:.0f} % of the mouth while the "
        f"feed runs, or when a lump comes to rest in "
        "it, and counts where the feed runs for four seconds longer than the delay meanwhile. It is found by an "
        "alarm between its begin and its end.",
        "",
        "The whole pipeline runs (picture quality, feed state, mouth, alarm), but for the "
        "belt's filter: lumps are followed "
        "as the truth has them, so the figures are those of the mouth and not of the filter.",
        "",
        "## Blockages",
        "",
        "| scene | | blockages | " + " | ".join(f"{m}: found | median, worst s" for m in METHODS) + " |",
        "|---|---|--:|" + "--:|--:|" * len(METHODS),
        *(_blocked_row(scene, runs) for scene in BLOCKED if ("blocked", scene.name) in runs),
        "",
        "Times are seconds from the begin of a blockage to the alarm. Those of `stops` hold the seconds in which the "
        "feed stood, which do not count for the alarm: a bridge that breaks soon after a stop is not announced. "
        "In pictures of this size the mouth is 43 px high, five rows of windows.",
        "",
        "## Normal crushing",
        "",
        "| scene | | hours | " + " | ".join(f"{m}: false" for m in METHODS) + " | blind, s |",
        "|---|---|--:|" + "--:|" * len(METHODS) + "--:|",
        *(_normal_row(scene, runs) for scene in NORMAL if ("normal", scene.name) in runs),
        "",
        "Blind: how long the region could not judge; of each feed the first ten seconds, in "
        "which the mouth is learned, are in it. "
        "False alarms beside the blockages of the table above: "
        + ", ".join(f"{method} {found[method]['beside']}" for method in METHODS)
        + ".",
        "",
        *_missing(runs),
        "## The peers",
        "",
        "Both call a mouth blocked in which too little has moved for the delay while the feed "
        "runs, by the same feed state: "
        "frame difference (10 grey levels after a blur) and OpenCV's MOG2 (history 50). Their "
        "thresholds part a clip of "
        "bridges and normal crushing best, which is not in the tables: "
        + ", ".join(f"{name} {100 * limit:.1f} % of the mouth" for name, limit in limits.items())
        + ". They were told what lumpwatch has to find out: pictures with truth.",
        "",
    ]
    return "\n".join(lines)


def _missing(runs: Runs) -> list[str]:
    """What is not in the tables."""
    scenes = [("blocked", scene.name) for scene in BLOCKED] + [("normal", scene.name) for scene in NORMAL]
    left = [f"{kind}: {name}" for kind, name in scenes if (kind, name) not in runs]
    return [f"Not run yet: {', '.join(left)}.", ""] if left else []


def _events(run: dict[str, Any]) -> list[tuple[float, float]]:
    return [
        (a, b)
        for (a, b), ran_s in zip(run["blocked"], run["ran_s"], strict=True)
        if ran_s >= DELAY_S + 4.0 - 1.0 / FPS
    ]


def _times(run: dict[str, Any], method: str) -> list[float | None]:
    """Of each blockage, how long it took; None: it was not found."""
    raised = run["raised"][method]
    return [next((t - a for t in raised if a <= t <= b + 1.0), None) for a, b in _events(run)]


def _false(run: dict[str, Any], method: str) -> int:
    """Alarms outside of everything that stood."""
    return sum(
        not any(a - 1.0 <= t <= b + _AFTER_S for a, b in run["blocked"]) for t in run["raised"][method]
    )


def _sum(runs: Runs, method: str) -> dict[str, Any]:
    times = [
        t
        for (kind, _), some in runs.items()
        if kind == "blocked"
        for one in some
        for t in _times(one, method)
    ]
    told = [t for t in times if t is not None]
    return {
        "blockages": len(times),
        "found": len(told),
        "late": sum(t > DELAY_S + 2.0 + 1e-6 for t in told),
        "latest": max(told, default=0.0),
        "false": sum(
            _false(one, method) for (kind, _), some in runs.items() if kind == "normal" for one in some
        ),
        "beside": sum(
            _false(one, method) for (kind, _), some in runs.items() if kind == "blocked" for one in some
        ),
    }


def _blocked_row(scene: Scene, runs: Runs) -> str:
    some = runs["blocked", scene.name]
    cells = []
    for method in METHODS:
        times = [t for one in some for t in _times(one, method)]
        told = sorted(t for t in times if t is not None)
        cells += [f"{len(told)}", f"{told[len(told) // 2]:.1f}, {told[-1]:.1f}" if told else "none"]
    return (
        f"| {scene.name} | {scene.about} | {sum(len(_events(one)) for one in some)} | "
        + " | ".join(cells)
        + " |"
    )


def _normal_row(scene: Scene, runs: Runs) -> str:
    some = runs["normal", scene.name]
    hours = sum(one["seconds"] for one in some) / 3600
    cells = [str(sum(_false(one, method) for one in some)) for method in METHODS]
    blind = sum(one["blind_s"] for one in some)
    return f"| {scene.name} | {scene.about} | {hours:.2f} | " + " | ".join(cells) + f" | {blind:.0f} |"
