"""`lumpwatch train`: learn a ROI's prior from a labelled video."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table

from service.cli.common import Commands, add_command, camera_of, progress, roi_of
from service.cli.refine import archive_of, keep_footage
from service.config import load
from service.labels import read_labels
from service.recordings import read_frames
from service.store.prior import Prior
from service.store.priors import PriorStore
from service.training import Trained
from service.training import train as run_training


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "train",
        train,
        "Learn motion models, their switching, sizes and likelihood of one ROI from a labelled video, and "
        "store them as a new prior. A running daemon takes it without a restart.",
        "lumpwatch train site.yaml clip.mp4 gt.txt --camera crusher-1 --roi apron",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("video", type=Path, metavar="VIDEO", help="video file or folder of images")
    parser.add_argument(
        "labels", type=Path, metavar="LABELS", help="labels, MOTChallenge text: frame,id,x,y,w,h,…"
    )
    parser.add_argument("--camera", required=True, metavar="ID", help="camera of the prior")
    parser.add_argument("--roi", required=True, metavar="ID", help="ROI of the prior")
    parser.add_argument(
        "--shadow", action="store_true", help="run it in shadow beside the prior in use, which stays"
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw what was learned")


def train(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load(arguments.config)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    boxes = read_labels(arguments.labels)
    only = camera.model_copy(update={"rois": (roi,)})
    frames, length = read_frames(only, arguments.video)
    with progress("reading", length) as advance:
        trained = run_training(roi, frames, boxes, arguments.labels, arguments.video.name, advance)
    stored = PriorStore(config.store.path, config.store.keep_priors).save(
        trained.as_prior(camera.id, roi, arguments.video.name, datetime.now(UTC)), shadow=arguments.shadow
    )
    keep_footage(archive_of(config, camera.id, roi), arguments.video, arguments.labels)
    for warning in trained.warnings:
        sys.stderr.write(f"lumpwatch: warning: {warning}\n")
    _print(trained, stored)
    if arguments.plot is not None:
        from service.plots import draw_prior

        draw_prior(stored, arguments.plot)
    return 0


def _print(trained: Trained, stored: Prior) -> None:
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
    Console().print(table)
