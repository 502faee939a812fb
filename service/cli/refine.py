"""`lumpwatch refine`: confirmed clips and all earlier footage -> a new version that runs in shadow."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from lumpwatch.service.cli.common import belt_of, camera_of, progress
from lumpwatch.service.cli.learning import Told, archive_of, judge, keep_footage, learn_from
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
