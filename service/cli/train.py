"""`lumpwatch train`: learn a ROI's prior from labelled clips, and propose labels for more of them."""

from __future__ import annotations

import argparse
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path

from lumpwatch.service.capture import read_frames
from lumpwatch.service.cli.common import belt_of, camera_of, progress
from lumpwatch.service.cli.learning import (
    Told,
    archive_of,
    draw_where_wanted,
    judge,
    keep_footage,
    learn_from,
)
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import CameraConfig, RoiConfig, SiteConfig, load_config
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.runtime import check_priors
from lumpwatch.service.storage import Prior, PriorStore
from lumpwatch.service.training import (
    Surest,
    accept,
    accept_proposals,
    clips_of,
    parse_ids,
    suggest,
    to_text,
)


def train(arguments: argparse.Namespace) -> int:
    """Run the command."""
    _check(arguments)
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    roi = belt_of(camera, arguments.roi)
    if arguments.suggest is not None:
        return _suggest(arguments, config, camera, roi)
    if arguments.accept is not None:
        many = accept_proposals(arguments.labels, parse_ids(arguments.accept))
        if not arguments.json:
            sys.stdout.write(f"{arguments.labels}: {many} accepted\n")
    return _train(arguments, config, camera, roi)


def _check(arguments: argparse.Namespace) -> None:
    """Raises ConfigError for arguments that do not go together."""
    if arguments.suggest is not None:
        if arguments.labels is not None or arguments.without_lumps or arguments.accept is not None:
            raise ConfigError("--suggest takes one VIDEO, without LABELS, --without-lumps or --accept")
        if arguments.suggest.exists():
            raise ConfigError(f"--suggest {arguments.suggest}: exists; proposals do not overwrite labels")
        if arguments.suggest.suffix == ".html":
            raise ConfigError(
                f"--suggest {arguments.suggest}: is a label file; its pictures go to .html beside it"
            )
        return
    if arguments.labels is None:
        raise ConfigError("LABELS is needed to train (or --suggest OUT, to have labels proposed)")
    if len(arguments.more) % 2:
        raise ConfigError(f"{arguments.more[-1]}: has no LABELS; videos and labels come in pairs")
    if arguments.accept is not None and arguments.more:
        raise ConfigError("--accept works on one VIDEO LABELS; accept the proposals of each file by itself")
    if arguments.report is not None and not arguments.report.absolute().parent.is_dir():
        raise ConfigError(f"--report {arguments.report}: there is no such folder")
    if arguments.folds < 0 or arguments.folds == 1:
        raise ConfigError(f"--folds {arguments.folds}: must be 0, or 2 and more")


def _suggest(arguments: argparse.Namespace, config: SiteConfig, camera: CameraConfig, roi: RoiConfig) -> int:
    from lumpwatch.service.training import contact_sheet

    only = camera.model_copy(update={"rois": (roi,)})
    check_priors(config.model_copy(update={"cameras": (only,)}))
    found = PriorStore(config.store.path, config.store.keep_priors).current(camera.id, roi.id)
    frames, length = read_frames(only, arguments.video)
    surest = Surest()
    with progress("watching", length) as advance:
        suggestions = suggest(only, found.prior, frames, advance, surest)
    sheet = arguments.suggest.with_suffix(".html")
    words = ("lumpwatch", "train", arguments.config, arguments.video, arguments.suggest)
    ids = ",".join(str(suggestion.proposal.id) for suggestion in suggestions)
    where = ("--camera", camera.id, "--roi", roi.id, "--accept", ids or "all")
    page = contact_sheet(suggestions, arguments.video.name, shlex.join(map(str, (*words, *where))))
    arguments.suggest.write_text(
        to_text([suggestion.proposal for suggestion in suggestions]), encoding="utf-8"
    )
    sheet.write_text(page, encoding="utf-8")
    by = f"prior version {found.prior.version}" if found.prior else "the stated defaults"
    if arguments.json:
        tell_json(
            {
                "labels": str(arguments.suggest),
                "page": str(sheet),
                "by": by,
                "highest_existence": surest.existence,
                "proposals": [
                    {"id": one.proposal.id, "first_s": one.first_s, "last_s": one.last_s}
                    for one in suggestions
                ],
            }
        )
        return 0
    if not suggestions:
        sys.stdout.write(f"No lump proposed by {by}.\n{_without_proposals(surest, arguments.suggest)}\n")
        return 0
    sys.stdout.write(
        f"{len(suggestions)} lumps proposed by {by}: {arguments.suggest}, pictures in {sheet}\n"
        "Look at the pictures, then train with --accept and the ids of those that are lumps.\n"
    )
    return 0


def _without_proposals(surest: Surest, out: Path) -> str:
    """What to do when there is nothing to look at."""
    where = "No frame could be judged: the picture was BLIND throughout. Learn a reference first (lumpwatch reference)."
    if surest.frame:
        box = "" if surest.box is None else ", box {} {} {} {} (x y w h)".format(*surest.box)
        where = (
            f"The highest existence was {surest.existence:.3f} in frame {surest.frame}, {surest.time_s:.1f} s{box}. "
            "A lump is proposed from 0.5 on, when it is followed for half a second."
        )
    return (
        f"{where}\n"
        "If there are lumps in the clip: set detector.likelihood.margin lower (0, then -1) for this, look whether the "
        "polygon holds where they come, and whether they are 40 pixels wide.\n"
        f"Or label by hand: a line of {out} is frame,id,x,y,w,h,1,1,1, frames from 1, box in pixels, one id for one "
        "lump, every frame from when it is half visible until it is gone (CVAT and Label Studio export it as MOT). "
        "Eight lumps are enough to begin with; then train without --suggest."
    )


def _train(arguments: argparse.Namespace, config: SiteConfig, camera: CameraConfig, roi: RoiConfig) -> int:
    store = PriorStore(config.store.path, config.store.keep_priors)
    store.check_writable(camera.id, roi.id)
    pairs = [
        (arguments.video, arguments.labels),
        *zip(arguments.more[::2], arguments.more[1::2], strict=True),
    ]
    clips = clips_of(pairs, arguments.without_lumps)
    told = Told(arguments.json)
    material, trained = learn_from(camera, roi, clips, told, choosing=True)

    def judged(stored: Prior) -> str | None:
        draw_where_wanted(arguments.plot, stored)
        return judge(arguments, store, roi, material, trained, stored, told)

    acceptance = accept(
        store,
        trained.as_prior(camera.id, roi, material.source, datetime.now(UTC)),
        judged,
        shadow=arguments.shadow,
        use_anyway=arguments.use_anyway,
    )
    keep_footage(archive_of(config, camera.id, roi), ((clip.video, clip.labels) for clip in clips), told)
    told.done(acceptance, len(clips))
    if acceptance.objection is None:
        return 0
    sys.stderr.write(
        f"lumpwatch: version {acceptance.prior.version} is stored and not in use: {acceptance.objection}; look at the "
        "report, then label more lumps, or train with --use-anyway, or try it with lumpwatch priors shadow "
        f"--version {acceptance.prior.version}\n"
    )
    return 1
