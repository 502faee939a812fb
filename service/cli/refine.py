"""`lumpwatch refine`: confirmed clips and all earlier footage -> a new version that runs in shadow."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

from lumpwatch.service.cli.common import belt_of, camera_of, progress
from lumpwatch.service.cli.learning import Told, add_judging, archive_of, judge, keep_footage, learn_from
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness
from lumpwatch.service.config import load_config
from lumpwatch.service.offline import archive
from lumpwatch.service.storage import Prior, PriorStore
from lumpwatch.service.training import (
    TrainingError,
    accept,
    confirmed_clips,
    missing_sources,
    unboxed,
    with_choices_of,
)


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "refine",
        refine_command,
        "Train a ROI anew on confirmed clips together with the footage that was kept of earlier trainings "
        "(learning.footage_mb), report on it as train does, and run the result in shadow beside the prior in use.",
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
    add_judging(parser)
    add_json(parser, "print what was learned and how it was judged as JSON")
    add_loudness(parser)


def refine_command(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    roi = belt_of(camera, arguments.roi)
    given = archive(arguments.videos, arguments.labels, arguments.unlabelled_is_empty)
    footage = archive_of(config, camera.id, roi)
    new = {footage.identity(clip.video, clip.labels) for clip in given}
    kept = [clip for clip in footage.clips() if clip.folder.name not in new]
    confirmed = [(clip.video, clip.labels) for clip in given]
    clips = confirmed_clips([*((clip.video, clip.labels) for clip in kept), *confirmed])
    if not any(clip.boxes for clip in clips):
        raise TrainingError("no clip has a labelled lump")
    told = Told(arguments.json)
    store = PriorStore(config.store.path, config.store.keep_priors)
    store.check_writable(camera.id, roi.id)
    before = store.current(camera.id, roi.id).prior
    if before is not None:
        for source in missing_sources(before.meta.source, [clip.name for clip in clips]):
            told.warn(
                f"{source}: version {before.version} learned from it, and it is neither given nor kept: "
                "what only it showed is not in the new version"
            )
    material, trained = learn_from(camera, roi, clips, told, choosing=False)
    trained = with_choices_of(trained, None if before is None else before.learned)

    def judged(stored: Prior) -> str | None:
        with progress("looking for lumps without a label", None):
            for one in unboxed(roi, material, trained.learned, range(len(kept), len(clips))):
                told.warn(one.words(material))
        return judge(arguments, store, roi, material, trained, stored, told)

    prior = trained.as_prior(camera.id, roi, material.source, datetime.now(UTC))
    acceptance = accept(store, prior, judged, shadow=True)
    keep_footage(footage, confirmed, told)
    stored = acceptance.prior
    told.say(
        f"{camera.id}/{roi.id}: version {stored.version} runs in shadow, learned from {len(clips)} clips with "
        f"{stored.learned.tracks} objects; promote or drop it with lumpwatch priors"
    )
    told.done(acceptance, len(clips))
    return 0
