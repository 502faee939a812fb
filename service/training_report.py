"""The report of a training: one page that a person can judge it by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.learning.learned import Learned, LumpFit
from models.likelihood.lump import FEATURES, MEASURES, WEIGHTS
from service import html
from service.clips import Material
from service.config import JdtConfig, LumpConfig, NetworkConfig, RoiConfig
from service.report_pictures import (
    moment_bgr,
    patterns_png,
    places_png,
    prior_png,
    reliability_png,
    sketch,
    template_png,
)
from service.store.prior import Prior
from service.training_checks import relative_sizes
from service.validation import HeldOut, Validation

MOST_MOMENTS = 6

_WORDS = {
    "brightness": "brighter than the ring around it",
    "contrast": "brighter or darker than the ring around it",
    "weakest_side": "stands out on every side",
    "texture": "rougher than the ring around it",
    "outline": "edges along its outline, not inside",
    "spread": "uneven brightness inside",
    "core_texture": "rough inside, measured by the contrast around",
    "ring_texture": "rough around, measured by the contrast there",
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
        (html.text(clip.name), html.text("no lump" if clip.labels is None else clip.labels.name))
        for clip in material.clips
    ]
    parts = [
        html.paragraph(
            f"Version {prior.version} of {meta.created:%Y-%m-%d %H:%M} UTC, from {learned.tracks} labelled lumps "
            f"in {meta.frames} frames.",
            "note",
        ),
        html.table(("clip", "labels"), clips),
        _warnings(warnings),
        _validation(material, validation),
        _motion(prior, material),
        _likelihood(roi.detector.learning, learned),
    ]
    return html.page(f"Training of {meta.camera}/{meta.roi}", parts)


def _warnings(warnings: Sequence[str]) -> str:
    if not warnings:
        return html.section("Warnings", [html.paragraph("None.")])
    return html.section("Warnings", [html.items(warnings)], "warn")


def _validation(material: Material, validation: Validation | None) -> str:
    title = "Each lump, judged by what the others teach"
    if validation is None or not validation.lumps:
        words = "Not done: it takes a jdt detector, two labelled lumps and --folds 2 or more."
        return html.section(title, [html.paragraph(words)])
    early = [one.warned_s for one in validation.found if one.warned_s is not None]
    summary = f"{len(early)} of {len(validation.whole)} lumps would be found"
    if early:
        summary += f", half of them {np.median(early):.1f} s or more before their last label"
    about = (
        f"The region was learned {validation.folds} times, each time without some of the lumps and without the "
        "pictures that show them. The log likelihood ratio of a held-out lump (blue) should lie above that of the "
        "background box that looks most like a lump (red), and above 0. A lump is found when the filter, above "
        "the alarm's threshold, puts a box on it."
    )
    names = ("lump", "clip", "lump's ratio", "hardest background", "ahead in", "over time", "found")
    rows = [_row(material, one) for one in validation.lumps]
    parts = [
        html.paragraph(summary + "."),
        html.paragraph(about, "note"),
        html.table(names, rows),
        *_clips(material, validation),
        "<h2>Hardest moments</h2>",
        html.paragraph("Green: the label. Red: the background that looks most like a lump.", "note"),
        '<div class="sheet">',
        *[_moment(material, one) for one in validation.hardest[:MOST_MOMENTS]],
        "</div>",
        "<h2>Reliability on held-out pictures</h2>",
        html.paragraph(_reliable(validation)),
        html.picture(reliability_png(validation.bins), "predicted probability against observed share"),
    ]
    return html.section(title, parts)


def _row(material: Material, one: HeldOut) -> tuple[str, ...]:
    if one.lump.cut_off:
        found = "the clip ends before it"
    elif one.warned_s is None:
        found = '<span class="bad">not found</span>'
    else:
        found = f'<span class="good">{one.warned_s:.1f} s before the end</span>'
    return (
        str(one.lump.id),
        html.text(material.clips[one.lump.clip].name),
        f"{one.ratio:+.1f}",
        f"{one.background:+.1f}",
        f"{one.won:.0%}",
        sketch(one),
        found,
    )


def _clips(material: Material, validation: Validation) -> list[str]:
    """The clips, the hardest first, where there are several."""
    by_clip: dict[int, list[HeldOut]] = {}
    for one in validation.lumps:
        by_clip.setdefault(one.lump.clip, []).append(one)
    if len(by_clip) < 2:
        return []
    rows = []
    for clip, lumps in sorted(by_clip.items(), key=lambda item: np.mean([one.margin for one in item[1]])):
        found = sum(one in validation.found for one in lumps)
        lead = np.mean([one.margin for one in lumps])
        rows.append(
            (
                html.text(material.clips[clip].name),
                f"{found} of {sum(not one.lump.cut_off for one in lumps)}",
                f"{lead:+.1f}",
            )
        )
    return ["<h2>Clips, the hardest first</h2>", html.table(("clip", "found", "mean lead"), rows)]


def _moment(material: Material, one: HeldOut) -> str:
    judged = one.hardest
    moment = material.footage.moments[judged.view]
    caption = (
        f"lump {one.lump.id} of {material.clips[moment.clip].name}, frame {moment.frame}: "
        f"{judged.ratio:+.1f} against {judged.background:+.1f}"
    )
    return html.figure(html.photo(moment_bgr(material, one, judged), caption), caption)


def _reliable(validation: Validation) -> str:
    """In words: whether the likelihood claims too much or too little."""
    objects = sum(one.objects for one in validation.bins)
    background = sum(one.background for one in validation.bins)
    weights = [one.objects / objects + one.background / background for one in validation.bins]
    lean = sum(
        weight * (one.observed - one.predicted) for weight, one in zip(weights, validation.bins, strict=True)
    ) / sum(weights)
    words = (
        "Held-out lumps, and of each of their pictures the box without a lump that looks most like one. "
        "A likelihood that can be trusted lies on the dashed line. "
    )
    if abs(lean) < 0.05:
        return words + "This one is close to it."
    more, less = ("more", "less") if lean > 0 else ("less", "more")
    return words + f"Boxes hold a lump {more} often than this one says: it claims {less} than it may."


def _motion(prior: Prior, material: Material) -> str:
    learned = prior.learned
    rows = [
        (
            html.text(name),
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
        html.table(
            ("motion model", "steps", "rate x, y (ROI heights / s²)", "noise (ROI heights / s)"), rows
        ),
        html.picture(places_png(material, learned), "switching and sizes over the picture"),
        html.paragraph(
            f"{covered} Sizes should grow towards the camera, and falling should begin at the lip.", "note"
        ),
        html.picture(prior_png(prior), "densities, prediction function, velocity and size by row"),
    ]
    return html.section("Motion, switching and sizes", parts)


def _likelihood(config: JdtConfig, learned: Learned) -> str:
    fit = learned.likelihood
    title = "What tells a lump from ore"
    if isinstance(config.likelihood, NetworkConfig):
        return html.section(title, [html.paragraph(f"The network {config.likelihood.model.name}.")])
    if not isinstance(fit, LumpFit):
        return html.section(
            title, [html.paragraph("The likeness of its histogram to that of the labelled lumps.")]
        )
    linear, square = fit.weights[: len(FEATURES)], fit.weights[len(FEATURES) : WEIGHTS]
    order = np.argsort(-(np.abs(linear) + np.abs(square))[: len(MEASURES)])
    rows = [
        (
            html.text(MEASURES[k]),
            html.text(_WORDS[MEASURES[k]]),
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
        html.paragraph(looks),
        html.paragraph(about, "note"),
        html.table(headings, rows),
        html.picture(template_png(fit), "what more brightness, texture or upright edges in each cell says"),
        html.paragraph(
            "The box (black) and what lies around it, cell by cell. Blue: more of it speaks for a lump; red: "
            "against.",
            "note",
        ),
    ]
    if len(fit.patterns.offsets):
        parts += [
            html.paragraph(
                f"{len(fit.patterns.offsets)} patterns tell what several of these say together, such as a crease at "
                "any of several places. They were learned elsewhere; this footage weighed them anew. Those with the "
                "most weight, a row each: blue adds to the pattern, red takes from it, and the number is what the "
                "pattern at its strongest adds to the log likelihood ratio.",
                "note",
            ),
            html.picture(patterns_png(fit), "the patterns with the most weight, cell by cell"),
        ]
    return html.section(title, parts)


def _says(weight: float) -> str:
    if abs(weight) < 0.05:
        return "says little"
    return f"speaks {'for' if weight > 0 else 'against'} a lump ({weight:+.2f})"


def _bend(weight: float) -> str:
    return "" if abs(weight) < 0.05 else f"speak {'for' if weight > 0 else 'against'} it ({weight:+.2f})"
