"""`lumpwatch refine`: confirmed clips and all earlier footage -> a new version that runs in shadow."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lumpwatch.service.cli.common import Commands, add_command, add_loudness, camera_of, progress, roi_of
from lumpwatch.service.config import RoiConfig, SiteConfig, load_config
from lumpwatch.service.offline import archive, boxes_of
from lumpwatch.service.storage import FootageArchive, Prior, PriorStore, StoreError
from lumpwatch.service.training import (
    accept,
    missing_sources,
    recorded_clip,
    refine,
    sources_text,
    with_choices_of,
)

_MEGABYTE = 1_000_000


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "refine",
        refine_command,
        "Train a ROI anew on confirmed clips together with the footage that was kept of earlier trainings "
        "(learning.footage_mb), and run the result in shadow beside the prior in use.",
        "lumpwatch refine site.yaml confirmed/*.mp4 --camera crusher-1 --roi apron",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "videos",
        type=Path,
        nargs="+",
        metavar="VIDEO",
        help="video file or folder of images, its labels beside it: clip.txt or gt.txt",
    )
    parser.add_argument("--labels", type=Path, nargs="+", metavar="FILE", help="labels, one file a video")
    parser.add_argument(
        "--unlabelled-is-empty",
        action="store_true",
        help="a video without labels shows no lump, such as a confirmed false alarm",
    )
    parser.add_argument("--camera", metavar="ID", help="camera of the prior (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the prior (default: the only one)")
    add_loudness(parser)


def refine_command(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    only = camera.model_copy(update={"rois": (roi,)})
    given = archive(arguments.videos, arguments.labels, arguments.unlabelled_is_empty)
    footage = archive_of(config, camera.id, roi)
    new = {footage.identity(clip.video, clip.labels) for clip in given}
    clips = [
        recorded_clip(only, kept.video.name, kept.video, boxes_of(kept.labels))
        for kept in footage.clips()
        if kept.folder.name not in new
    ]
    clips += [recorded_clip(only, clip.video.name, clip.video, clip.boxes) for clip in given]
    names = [clip.name for clip in clips]
    store = PriorStore(config.store.path, config.store.keep_priors)
    store.check_writable(camera.id, roi.id)
    _warn_of_what_is_missing(store.current(camera.id, roi.id).prior, names)
    with progress("reading", None) as advance:
        trained = refine(roi, clips, advance)

    def warn_and_keep(_: Prior) -> None:
        for warning in trained.warnings:
            _warn(warning)
        for clip in given:
            keep_footage(footage, clip.video, clip.labels)

    before = store.current(camera.id, roi.id).prior
    trained = with_choices_of(trained, None if before is None else before.learned)
    prior = trained.as_prior(camera.id, roi, sources_text(names), datetime.now(UTC))
    stored = accept(store, prior, warn_and_keep, shadow=True).prior
    print(  # noqa: T201
        f"{camera.id}/{roi.id}: version {stored.version} runs in shadow, learned from {len(clips)} clips with "
        f"{stored.learned.tracks} objects; promote or drop it with lumpwatch priors"
    )
    return 0


def archive_of(config: SiteConfig, camera: str, roi: RoiConfig) -> FootageArchive:
    """The footage that is kept of a ROI."""
    return FootageArchive(config.store.path, camera, roi.id, roi.learning.footage_mb * _MEGABYTE)


def keep_footage(footage: FootageArchive, video: Path, labels: Path | None) -> None:
    """Keep a clip that was trained on, where that is wanted, and report what had to go or cannot be kept."""
    try:
        for name in footage.add(video, labels, np.random.default_rng()):
            _warn(f"{name}: let go, the footage kept is bounded by learning.footage_mb")
    except StoreError as error:
        _warn(str(error))  # the prior is stored: what is wrong with the footage does not undo that


def _warn_of_what_is_missing(prior: Prior | None, names: list[str]) -> None:
    if prior is None:
        return
    for source in missing_sources(prior.meta.source, names):
        _warn(
            f"{source}: version {prior.version} learned from it, and it is neither given nor kept: "
            "what only it showed is not in the new version"
        )


def _warn(text: str) -> None:
    sys.stderr.write(f"lumpwatch: warning: {text}\n")
