"""What `train` and `refine` do alike: learn from gathered clips, have the result judged, write the report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lumpwatch.models.learning.learned import HistogramFit, Learned
from lumpwatch.service.cli.common import progress
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import CameraConfig, RoiConfig, SiteConfig
from lumpwatch.service.offline import PlotError, draw_prior
from lumpwatch.service.storage import FootageArchive, Prior, PriorStore, StoreError
from lumpwatch.service.training import (
    CANDIDATES,
    HISTOGRAM_TRIALS,
    TRIALS,
    Acceptance,
    Clip,
    Material,
    Trained,
    Tried,
    Validation,
    choose,
    coverage_warnings,
    cross_validate,
    cut_lumps,
    gather,
    learn,
    objection_to,
    tempered,
    training_report,
    validation_warnings,
)

_MEGABYTE = 1_000_000


@dataclass(slots=True)
class Told:
    """What is said of a training, to a person at once and to a program at the end."""

    as_json: bool
    warnings: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def warn(self, text: str) -> None:
        """A warning, on standard error."""
        self.warnings.append(text)
        sys.stderr.write(f"lumpwatch: warning: {text}\n")

    def say(self, line: str) -> None:
        """A line for a person."""
        if not self.as_json:
            sys.stdout.write(f"{line}\n")

    def table(self, table: Table) -> None:
        """A table for a person."""
        if not self.as_json:
            Console(markup=False).print(table)

    def done(self, acceptance: Acceptance, clips: int) -> None:
        """The facts for a program, where it asked for them."""
        if not self.as_json:
            return
        prior = acceptance.prior
        tell_json(
            {
                "camera": prior.meta.camera,
                "roi": prior.meta.roi,
                "version": prior.version,
                "objection": acceptance.objection,
                "clips": clips,
                "objects": prior.learned.tracks,
                "frames": prior.meta.frames,
                **self.facts,
                "warnings": self.warnings,
            }
        )


def learn_from(
    camera: CameraConfig, roi: RoiConfig, clips: tuple[Clip, ...], told: Told, *, choosing: bool
) -> tuple[Material, Trained]:
    """Read the clips and learn from them; a tracker's settings are chosen anew where `choosing`."""
    material = gather(camera, roi, clips, lambda name, length: progress(f"reading {name}", length))
    named = ", ".join(str(clip.labels) for clip in clips if clip.labels is not None)
    trained = learn(roi, material.footage, material.tracks, named)
    if choosing:
        with progress("choosing", CANDIDATES) as advance:
            learned, tried = choose(camera, roi, material, trained.learned, advance)
        trained = replace(trained, learned=learned)
        _tell_choice(told, learned, tried)
    histogram = isinstance(trained.learned.likelihood, HistogramFit)
    with progress("tempering", HISTOGRAM_TRIALS if histogram else TRIALS) as advance:
        return material, tempered(roi, material.footage, trained, advance)


def judge(
    arguments: argparse.Namespace,
    store: PriorStore,
    roi: RoiConfig,
    material: Material,
    trained: Trained,
    stored: Prior,
    told: Told,
) -> str | None:
    """Check what was learned and write the report; what speaks against its use."""
    _tell_models(told, trained, stored)
    with progress("cross-validation", min(arguments.folds, len(material.lumps))) as advance:
        validation = cross_validate(roi, material, arguments.folds, advance, trained.learned)
    own = [*trained.warnings, *coverage_warnings(material, trained.learned)]
    if validation is not None:
        own += validation_warnings(validation, material)
        told.say(in_words(validation, material))
        told.facts["held_out"] = {"lumps": len(validation.whole), "found": len(validation.found)}
    for warning in own:
        told.warn(warning)
    try:
        store.keep_lumps(stored.meta.camera, roi.id, stored.version, cut_lumps(material, validation))
    except StoreError as error:
        told.warn(f"proof tests will draw their lump: {error}")  # the prior is stored all the same
    objection = objection_to(validation)
    paths = [store.report_path(stored.meta.camera, roi.id, stored.version)]
    if arguments.report is not None:
        paths.append(arguments.report)
    try:
        page = training_report(stored, roi, material, validation, told.warnings)
    except PlotError as error:
        if arguments.report is not None:
            raise
        sys.stderr.write(f"lumpwatch: no report: {error}\n")
        return objection
    for path in paths:
        path.write_text(page, encoding="utf-8")
    told.facts["report"] = str(paths[-1])
    told.say(f"report: {paths[-1]}")
    return objection


def draw_where_wanted(path: Path | None, stored: Prior) -> None:
    """What was learned as a picture."""
    if path is not None:
        draw_prior(stored, path)


def archive_of(config: SiteConfig, camera: str, roi: RoiConfig) -> FootageArchive:
    """The footage that is kept of a ROI."""
    return FootageArchive(config.store.path, camera, roi.id, roi.learning.footage_mb * _MEGABYTE)


def keep_footage(footage: FootageArchive, clips: Iterable[tuple[Path, Path | None]], told: Told) -> None:
    """Keep clips that were trained on, with their labels as they were given, where that is wanted.

    What had to go for them, or cannot be kept, is told.
    """
    for video, labels in clips:
        try:
            for name in footage.add(video, labels, np.random.default_rng()):
                told.warn(f"{name}: let go, the footage kept is bounded by learning.footage_mb")
        except StoreError as error:
            told.warn(str(error))  # the prior is stored: what is wrong with the footage does not undo that


def in_words(validation: Validation, material: Material) -> str:
    """How many lumps would be found by what the others teach, in a sentence."""
    if not validation.lumps:
        return "Held out: no lump could be judged."
    worst = validation.hardest[0]
    beyond = len(material.lumps) - len(validation.whole)
    left = f" ({beyond} more are cut off by the end of a clip, or could not be judged)" if beyond else ""
    return (
        f"Held out: {len(validation.found)} of {len(validation.whole)} lumps would be found by what the others "
        f"teach{left}; the hardest is {worst.lump.id} of {material.clips[worst.lump.clip].name}."
    )


def _tell_choice(told: Told, learned: Learned, tried: Sequence[Tried]) -> None:
    fit = learned.tracker
    if fit is None or not tried:
        return
    table = Table(title="chosen by (SFDA + ATA) / 2 on the training clip")
    for heading in ("candidate", "score", "chosen"):
        table.add_column(heading)
    for one in tried:
        table.add_row(one.text, f"{one.score:.3f}", "yes" if one.chosen else "")
    told.table(table)
    if fit.size is not None:
        told.say(
            f"size: height = {fit.size.slope:.3f} row {fit.size.offset:+.3f} ROI heights, "
            f"width = {fit.size.aspect:.2f} height"
        )
    noise = fit.noise
    told.say(
        f"noise in a second: position {noise.position:.3f}, velocity {noise.velocity:.3f}, "
        f"acceleration {noise.acceleration:.3f} ROI heights"
    )


def _tell_models(told: Told, trained: Trained, stored: Prior) -> None:
    learned = trained.learned
    table = Table(title=f"{stored.meta.camera}/{stored.meta.roi}: prior version {stored.version}")
    for heading in ("motion model", "steps", "rate x, y (ROI heights / s²)", "noise (ROI heights / s)"):
        table.add_column(heading)
    for m, name in enumerate(learned.models):
        rate = learned.rates[m]
        table.add_row(
            name,
            str(learned.label_counts[m]),
            f"{rate[0]:+.3f}, {rate[1]:+.3f}",
            f"{learned.velocity_noise[m]:.3f}",
        )
    told.table(table)
    told.say(
        "steps: from one labelled frame to the next; rate: acceleration; noise: by how much speeds differ from that. "
        "ROI heights: heights of the region."
    )
    if isinstance(learned.likelihood, HistogramFit) and learned.tracker is None:
        told.say(f"evidence: {learned.likelihood.evidence:g} of each frame's log likelihood ratio counts")
