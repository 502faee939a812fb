"""The report of a training: one page that a person can judge it by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lumpwatch.models.learning.learned import Learned, LumpFit
from lumpwatch.models.learning.validation import Bin
from lumpwatch.models.likelihood.lump import FEATURES, WEIGHTS
from lumpwatch.service.config import JdtConfig, LumpConfig, NetworkConfig, RoiConfig
from lumpwatch.service.offline import (
    html_figure,
    html_items,
    html_page,
    html_paragraph,
    html_photo,
    html_picture,
    html_section,
    html_table,
    html_text,
)
from lumpwatch.service.storage import Prior
from lumpwatch.service.training.coverage import relative_sizes
from lumpwatch.service.training.cross_validation import HeldOut, Validation
from lumpwatch.service.training.dataset import Material
from lumpwatch.service.training.report_pictures import (
    moment_bgr,
    places_png,
    prior_png,
    reliability_png,
    sketch,
)

MOST_MOMENTS = 6
CLOSE, FAR = 0.05, 0.15
"""Mean absolute deviation from the diagonal up to which a likelihood is trusted, and beyond which it is not."""

_WORDS = {
    "body": "lies on a body with an outline",
    "body_core": "its core lies on a body",
    "body_ring": "the ring around it lies on bodies too",
    "edge_core": "outlines pass through its core",
    "edge_rim": "an outline passes along its rim",
    "edge_ring": "outlines pass through the ring around it",
    "edge_weakest": "an outline passes even along its weakest side",
    "edge_second": "an outline passes along its second weakest side",
    "body_weakest": "even its weakest quarter lies on a body",
    "left": "its body ends further right on the left side",
    "upper": "its body ends further down at the top",
    "right": "its body ends further right on the right side",
    "lower": "its body ends further down at the bottom",
    "votes": "its cells tell of a body about as large, there",
    "close_votes": "its cells tell of a body of just that box",
    "agreement": "those of its cells that lie on a body tell of that box",
    "size_around": "larger than what lies around it",
    "size_ring": "larger than what touches it",
    "size_usual": "larger than what usually lies in the region",
    "bodies_around": "larger than the bodies around it",
    "bodies_usual": "larger than bodies usually are in the region",
    "size": "larger than lumps are at its row",
    "aspect": "wider than high",
}


def training_report(
    prior: Prior,
    roi: RoiConfig,
    material: Material,
    validation: Validation | None,
    warnings: Sequence[str],
) -> str:
    """The page. Raises PlotError where matplotlib is missing."""
    meta = prior.meta
    learned = prior.learned
    clips = [
        (html_text(clip.name), html_text("no lump" if clip.labels is None else clip.labels.name))
        for clip in material.clips
    ]
    parts = [
        html_paragraph(
            f"Version {prior.version} of {meta.created:%Y-%m-%d %H:%M} UTC, from {learned.tracks} labelled lumps "
            f"in {meta.frames} frames.",
            "note",
        ),
        html_table(("clip", "labels"), clips),
        _warnings(warnings),
        _validation(material, validation),
        _motion(prior, material),
        _likelihood(roi.detector.learning, learned),
    ]
    return html_page(f"Training of {meta.camera}/{meta.roi}", parts)


def _warnings(warnings: Sequence[str]) -> str:
    if not warnings:
        return html_section("Warnings", [html_paragraph("None.")])
    return html_section("Warnings", [html_items(warnings)], "warn")


def _validation(material: Material, validation: Validation | None) -> str:
    title = "Each lump, judged by what the others teach"
    if validation is None or not validation.lumps:
        words = "Not done: it takes a jdt detector, two labelled lumps and --folds 2 or more."
        return html_section(title, [html_paragraph(words)])
    early = [held.warned_s for held in validation.found if held.warned_s is not None]
    summary = f"{len(early)} of {len(validation.whole)} lumps would be found"
    if early:
        summary += f", half of them {np.median(early):.1f} s or more before their last label"
    about = (
        f"The region was learned {validation.folds} times, each time without some of the lumps and without the "
        "pictures that show them. The log likelihood ratio of a held-out lump (blue) should lie above that of the "
        "background box that looks most like a lump (red), and above 0. A lump is found when the alarm, by its "
        "thresholds and delays, stands with a box on it."
    )
    names = ("lump", "clip", "lump's ratio", "hardest background", "ahead in", "over time", "found")
    rows = [_row(material, held) for held in validation.lumps]
    parts = [
        html_paragraph(summary + "."),
        html_paragraph(about, "note"),
        html_table(names, rows),
        *_clips(material, validation),
        "<h2>Hardest moments</h2>",
        html_paragraph("Green: the label. Red: the background that looks most like a lump.", "note"),
        '<div class="sheet">',
        *[_moment(material, held) for held in validation.hardest[:MOST_MOMENTS]],
        "</div>",
        "<h2>Reliability on held-out pictures</h2>",
        html_paragraph(reliable(validation.bins)),
        html_picture(reliability_png(validation.bins), "predicted probability against observed share"),
    ]
    return html_section(title, parts)


def _row(material: Material, held: HeldOut) -> tuple[str, ...]:
    if held.lump.cut_off:
        found = "the clip ends before it"
    elif held.warned_s is None:
        found = '<span class="bad">not found</span>'
    else:
        found = f'<span class="good">{held.warned_s:.1f} s before the end</span>'
    return (
        str(held.lump.id),
        html_text(material.clips[held.lump.clip].name),
        f"{held.ratio:+.1f}",
        f"{held.background:+.1f}",
        f"{held.won:.0%}",
        sketch(held),
        found,
    )


def _clips(material: Material, validation: Validation) -> list[str]:
    """The clips, the hardest first, where there are several."""
    by_clip: dict[int, list[HeldOut]] = {}
    for held in validation.lumps:
        by_clip.setdefault(held.lump.clip, []).append(held)
    if len(by_clip) < 2:
        return []
    rows = []
    for clip, lumps in sorted(by_clip.items(), key=lambda item: np.mean([held.margin for held in item[1]])):
        found = sum(held in validation.found for held in lumps)
        lead = np.mean([held.margin for held in lumps])
        rows.append(
            (
                html_text(material.clips[clip].name),
                f"{found} of {sum(not held.lump.cut_off for held in lumps)}",
                f"{lead:+.1f}",
            )
        )
    return ["<h2>Clips, the hardest first</h2>", html_table(("clip", "found", "mean lead"), rows)]


def _moment(material: Material, held: HeldOut) -> str:
    judged = held.hardest
    moment = material.footage.moments[judged.view]
    caption = (
        f"lump {held.lump.id} of {material.clips[moment.clip].name}, frame {moment.frame}: "
        f"{judged.ratio:+.1f} against {judged.background:+.1f}"
    )
    return html_figure(html_photo(moment_bgr(material, held, judged), caption), caption)


def reliable(bins: Sequence[Bin]) -> str:
    """In words: whether the likelihood claims too much or too little."""
    objects = sum(group.objects for group in bins)
    background = sum(group.background for group in bins)
    weights = [group.objects / objects + group.background / background for group in bins]
    off = [group.observed - group.predicted for group in bins]
    # Bins that claim too much and bins that claim too little must not make up for each other.
    away = sum(w * abs(one) for w, one in zip(weights, off, strict=True)) / sum(weights)
    lean = sum(w * one for w, one in zip(weights, off, strict=True)) / sum(weights)
    words = (
        "Held-out lumps, and of each of their pictures the box without a lump that looks most like one. "
        "A likelihood that can be trusted lies on the dashed line. "
    )
    if away < CLOSE:
        return words + f"Verdict: it can be trusted; on average it is {away:.0%} off."
    verdict = "use it with care" if away < FAR else "do not read it as a probability"
    how = "in some places too much and in others too little"
    if abs(lean) > 0.7 * away:
        how = "less than it may" if lean > 0 else "more than it may"
    return words + f"Verdict: {verdict}; on average it is {away:.0%} off and claims {how}."


def _motion(prior: Prior, material: Material) -> str:
    learned = prior.learned
    rows = [
        (
            html_text(name),
            str(learned.label_counts[m]),
            f"{learned.rates[m, 0]:+.3f}, {learned.rates[m, 1]:+.3f}",
            f"{learned.velocity_noise[m]:.3f}",
        )
        for m, name in enumerate(learned.models)
    ]
    sizes = relative_sizes(material, learned)
    covered = (
        f"Against what their rows expect, the lumps are {min(sizes):.2f} to {max(sizes):.2f} times as large."
        if sizes
        else ""
    )
    parts = [
        html_table(
            ("motion model", "steps", "rate x, y (ROI heights / s²)", "noise (ROI heights / s)"), rows
        ),
        html_picture(places_png(material, learned), "switching and sizes over the picture"),
        html_paragraph(
            f"{covered} Sizes should grow towards the camera, and falling should begin at the lip.", "note"
        ),
        html_picture(prior_png(prior), "densities, prediction function, velocity and size by row"),
    ]
    return html_section("Motion, switching and sizes", parts)


def _likelihood(config: JdtConfig, learned: Learned) -> str:
    fit = learned.likelihood
    title = "What tells a lump from ore"
    if isinstance(config.likelihood, NetworkConfig):
        return html_section(title, [html_paragraph(f"The network {config.likelihood.model.name}.")])
    if not isinstance(fit, LumpFit):
        return html_section(
            title, [html_paragraph("The likeness of its histogram to that of the labelled lumps.")]
        )
    linear, square = fit.weights[: len(FEATURES)], fit.weights[len(FEATURES) : WEIGHTS]
    order = np.argsort(-(np.abs(linear) + np.abs(square)), kind="stable")
    rows = [
        (
            html_text(FEATURES[k]),
            html_text(_WORDS[FEATURES[k]]),
            _says(float(linear[k])),
            _bend(float(square[k])),
        )
        for k in order
    ]
    about = (
        "By weight, features standardised: how much one standard deviation adds to the log likelihood ratio."
    )
    headings = ("feature", "measures", "more of it", "unusual values")
    given = isinstance(config.likelihood, LumpConfig) and config.likelihood.evidence is not None
    looks = (
        "How much of a frame counts is configured (evidence)."
        if given
        else f"A second of frames counts as {fit.looks_per_s:g} independent looks."
    )
    parts = [
        html_paragraph(looks),
        html_paragraph(about, "note"),
        html_table(headings, rows),
    ]
    if len(fit.patterns.offsets):
        parts.append(
            html_paragraph(
                f"{len(fit.patterns.offsets)} patterns tell what several of these say together. They were learned "
                "elsewhere; this footage weighed them anew.",
                "note",
            )
        )
    return html_section(title, parts)


def _says(weight: float) -> str:
    if abs(weight) < 0.05:
        return "says little"
    return f"speaks {'for' if weight > 0 else 'against'} a lump ({weight:+.2f})"


def _bend(weight: float) -> str:
    return "" if abs(weight) < 0.05 else f"speak {'for' if weight > 0 else 'against'} it ({weight:+.2f})"
