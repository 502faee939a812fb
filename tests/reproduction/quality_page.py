"""The page of the experiment on picture quality, and its plot."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.reproduction.quality import Clean, Outcome

_OPENING = """# Is the picture fit?

`python -m tests.reproduction quality`: simulated cameras of both styles, {fps:g} pictures a second. A reference
is learned from {learn:g} s of each kind of feed below (five by day, one by night) and judged on other stretches
of the same cameras; a belt that stands is judged by a reference of {twice:g} s in which it ran all the time. Faults
are laid over the standard feed for {fault:g} s.

"""


def page(clean: list[Clean], outcomes: list[Outcome], costs: dict[str, float]) -> str:
    """docs/results/quality.md."""
    from tests.reproduction.quality import AFTER_S, FAULT_S, FPS, LEARN_S

    parts = [_OPENING.format(fps=FPS, learn=LEARN_S, twice=2 * LEARN_S, fault=FAULT_S)]
    parts.append("## Without a fault\n\n| feed | style | pictures | BLIND |\n|---|---|---|---|\n")
    total: Counter[str] = Counter()
    for one in clean:
        total["frames"] += one.frames
        total["blind"] += one.blind.total()
        told = ", ".join(f"{count} {reason}" for reason, count in one.blind.items()) or "0"
        lumps = "lumps" if one.lumps else "no lumps"
        parts.append(f"| {one.kind}, {lumps} | {one.style} | {one.frames} | {told} |\n")
    share = 100 * total["blind"] / total["frames"]
    minutes = total["frames"] / FPS / 60
    parts.append(
        f"\nBLIND for {total['blind']} of {total['frames']} pictures ({minutes:.0f} minutes): {share:.2f} %.\n"
    )
    parts.append(
        "\n## Faults\n\nSeconds from the fault's first picture to BLIND for one of its reasons, and from its last one "
        "until the region sees again. A small shift is not BLIND: the region follows. What is coded again has a key "
        "frame each second, by so much later it may be found.\n\n"
        "![Time until each fault was found, against the stated time](../images/quality.png)\n\n"
        "| fault | style | found after | stated | said, in order | sees again after |\n|---|---|---|---|---|---|\n"
    )
    for out in outcomes:
        found = "not found" if out.found_s is None else f"{out.found_s:.1f} s"
        recovered = f"not in {AFTER_S:g} s" if out.recovered_s is None else f"{out.recovered_s:.1f} s"
        said = ", ".join(out.reasons) or f"nothing; followed by {out.followed_px[0]}, {out.followed_px[1]} px"
        parts.append(
            f"| {out.case} | {out.style} | {found} | {out.stated_s:.1f} s | {said} | {recovered} |\n"
        )
    measured = 5 * (costs["look"] + costs["activity"]) + costs["registration"]
    ratio = 100 * measured / (15 * costs["filter"])
    parts.append(
        "\n## Cost\n\nMilliseconds, medians: "
        f"{costs['look']:.2f} for the measures of a region, {costs['activity']:.2f} for what changed (both five "
        f"times a second), {costs['registration']:.2f} for the registration (once a second). At 15 frames a second "
        f"that is {measured / 15:.2f} ms a frame, {ratio:.0f} % of a step of the filter ({costs['filter']:.1f} ms).\n"
    )
    return "".join(parts)


def draw(outcomes: list[Outcome], path: Path) -> None:
    """Dots against the stated time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(out.case for out in outcomes))
    figure, axes = plt.subplots(figsize=(8.0, 4.2), layout="constrained")
    stated = {out.case: out.stated_s for out in outcomes}
    rows = range(len(names))
    axes.barh(rows, [stated[name] for name in names], color="0.9", label="stated")
    for style, marker in (("a", "o"), ("b", "D")):
        points = [
            (out.found_s, names.index(out.case))
            for out in outcomes
            if out.style == style and out.found_s is not None
        ]
        axes.plot(*zip(*points, strict=True), marker, label=f"found, style {style}", markersize=5)
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.set_xlabel("seconds from the beginning of the fault")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=110)
    plt.close(figure)
