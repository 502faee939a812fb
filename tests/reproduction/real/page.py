"""docs/results/real.md: what was found on feeds of real pixels, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lumpwatch.models.intervals import binomial_interval, poisson_upper
from tests.reproduction.real.feeds import Site
from tests.reproduction.real.judge import LEAST_WARNING_S
from tests.reproduction.real.runner import Outcome, kind_of

WAYS = {
    "trained": "lumpwatch, one labelled minute",
    "untrained": "lumpwatch, untrained",
    "mog2": "MOG2 and blob size",
    "contours": "threshold and contours",
}
KINDS = {
    "scroll": "real frames joined along seams, nothing pasted; lumps are the outlined rocks above a size limit",
    "composite": "fine ore with medium rocks, real rocks laid on it as lumps; not calibrated",
    "calibrated": "the same, calibrated with `limit_mm`",
    "quarry": "stones of all sizes side by side, a few boulders among them; some calibrated",
    "cctv": "a steel plant's belts through its own camera; as they are, and with rocks laid on that move along",
}
_OPENING = f"""<!-- Written by `make reproduce`. -->

# Lumps of real pixels

Feeds of a minute, 640 pixels wide, H.264, made of real pictures, watched by the command line alone: `lumpwatch
train` on one minute with labels, `lumpwatch replay` of another minute with other rocks and of one without lumps. A
lump is announced where the state is LUMP with a box on it (intersection over union above 0.3) {LEAST_WARNING_S:g} s
before it leaves the region or earlier. An alarm during which no box lay on a lump is false; rocks between 0.8 and 1
times the limit, and large ones that a seam cuts, count neither way. The simple methods learn sizes and their
threshold from the same labelled minute.
"""
_SOURCES = """
The pictures are not in the repository (their licence is not clear): `belt-ore` (174 crops of frames of ore on a
belt, every rock outlined) and `belt-cctv` (two belts, five seconds each), looked for in `$LUMPWATCH_FOOTAGE`, then in
`../shared/data`. Crops are joined to the frames that they were cut from. Splits are by frame: five serve what ships,
one development, two the test on this page; the shipped net saw none of the test's. Half of a split's frame teaches a
site and the other half is watched.

How `histogram` follows thrown and kicked balls: [adaptive motion models](paper1.md).
"""


def write(outcomes: Sequence[Outcome], sites: Sequence[Site], split: str, missing: Sequence[str]) -> str:
    """The page."""
    parts = [_OPENING]
    if missing:
        parts.append("**Missing here, and left out:** " + "; ".join(missing) + ".\n")
    if outcomes:
        parts += [_summary(outcomes), _by_site(outcomes, sites)]
    parts.append(f"`python -m tests.reproduction real` writes this page (split `{split}`).{_SOURCES}")
    return "\n".join(parts)


def _summary(outcomes: Sequence[Outcome]) -> str:
    ways = [way for way in WAYS if any(one.way == way for one in outcomes)]
    kinds = [kind for kind in KINDS if any(kind_of(one.site) == kind for one in outcomes)]
    head = "| feeds | " + " | ".join(WAYS[way] for way in ways) + " |\n|---|" + "---|" * len(ways)
    found = [head]
    for kind in kinds:
        mine = [[one for one in outcomes if one.way == way and kind_of(one.site) == kind] for way in ways]
        found.append(f"| `{kind}` | " + " | ".join(_announced(part) for part in mine) + " |")
    parts = [[one for one in outcomes if one.way == way] for way in ways]
    found.append("| all | " + " | ".join(f"**{_announced(part)}**" for part in parts) + " |")
    found.append("| 95 % interval | " + " | ".join(_interval(part) for part in parts) + " |")
    found.append(
        "| false alarms, minutes with lumps | " + " | ".join(_false(part, "watch") for part in parts) + " |"
    )
    found.append(
        "| false alarms, minutes without | " + " | ".join(_false(part, "quiet") for part in parts) + " |"
    )
    found.append(
        "| share of those minutes in alarm | " + " | ".join(_standing(part) for part in parts) + " |"
    )
    kinds_told = "\n".join(f"- `{kind}`: {KINDS[kind]};" for kind in kinds)
    return "## Announced in time\n\n" + "\n".join(found) + "\n\n" + kinds_told.rstrip(";") + ".\n"


def _standing(outcomes: Sequence[Outcome]) -> str:
    """What one false alarm that never ends hides."""
    judged = [one.quiet.standing for one in outcomes if one.quiet is not None]
    return f"{np.mean(judged):.0%}" if judged else "-"


def _lumps(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    watched = [one.watch for one in outcomes if one.watch is not None]
    return sum(one.announced for one in watched), sum(len(one.lumps) for one in watched)


def _announced(outcomes: Sequence[Outcome]) -> str:
    found, total = _lumps(outcomes)
    failed = sum(bool(one.problem) for one in outcomes)
    return (f"{found} of {total}" if total else "-") + (f" ({failed} failed)" if failed else "")


def _interval(outcomes: Sequence[Outcome]) -> str:
    found, total = _lumps(outcomes)
    if not total:
        return "-"
    low, high = binomial_interval(found, total)
    return f"{low:.0%} to {high:.0%}"


def _false(outcomes: Sequence[Outcome], role: str) -> str:
    minutes = [one.watch if role == "watch" else one.quiet for one in outcomes]
    judged = [one for one in minutes if one is not None]
    if not judged:
        return "-"
    alarms, hours = sum(one.false_alarms for one in judged), sum(one.seconds for one in judged) / 3600
    return f"{alarms} in {60 * hours:.0f} min (below {poisson_upper(alarms, hours):.0f} an hour)"


def _by_site(outcomes: Sequence[Outcome], sites: Sequence[Site]) -> str:
    told = {site.name: _told(site) for site in sites}
    rows = [
        "| feed | what | method | announced | median warning (s) | false with, without lumps |",
        "|---|---|---|---|---|---|",
    ]
    before = ""
    for one in outcomes:
        lumps = one.watch.lumps if one.watch is not None else ()
        leads = [lump.warned_s for lump in lumps if lump.announced and lump.warned_s is not None]
        first = (f"`{one.site}`", told.get(one.site, "")) if one.site != before else ("", "")
        before = one.site
        false = [str(part.false_alarms) if part is not None else "-" for part in (one.watch, one.quiet)]
        cells = [*first, WAYS.get(one.way, one.way), _announced([one])]
        cells += [f"{np.median(leads):.1f}" if leads else "-", ", ".join(false)]
        rows.append("| " + " | ".join(cells) + " |")
    return "## Feed by feed\n\n" + "\n".join(rows) + "\n"


def _told(site: Site) -> str:
    view, air = site.view, site.air
    words = [
        f"{view.width}x{view.height}",
        "from above" if view.tilt_deg == 0 else f"tilted {view.tilt_deg:.0f}°",
        "grey" if air.grey else "colour",
        f"look {site.look}",
        f"a lump from {site.limit / view.belt:.0%} of the belt's width",
    ]
    if site.mm is not None:
        words.append(f"limit {site.limit * site.mm:.0f} mm")
    if air.dust:
        words.append("dust")
    if air.shadow:
        words.append("a beam's shadow")
    return ", ".join(words)
