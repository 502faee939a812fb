"""`lumpwatch snapshot` and `lumpwatch record`: a still and a clip of a camera of the configuration."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lumpwatch.service.cli.common import camera_of, progress
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.errors import ConfigError, LumpwatchError


def snapshot_command(arguments: argparse.Namespace) -> int:
    """Run `snapshot`."""
    from lumpwatch.service.capture import snapshot

    camera = camera_of(load_config(arguments.config), arguments.camera)
    picture = snapshot(camera)
    save_picture(arguments.out, picture)
    if arguments.json:
        size = {"width": picture.shape[1], "height": picture.shape[0]}
        tell_json({"camera": camera.id, "file": str(arguments.out), **size})
        return 0
    sys.stdout.write(f"{camera.id}: {picture.shape[1]}x{picture.shape[0]} picture in {arguments.out}\n")
    return 0


def record_command(arguments: argparse.Namespace) -> int:
    """Run `record`."""
    from lumpwatch.service.capture import record

    if arguments.out.suffix not in (".mp4", ".mkv", ".mov"):
        raise ConfigError(f"--out {arguments.out}: must end in .mp4, .mkv or .mov")
    if arguments.out.exists():
        raise ConfigError(f"--out {arguments.out}: exists; clips are not overwritten")
    camera = camera_of(load_config(arguments.config), arguments.camera)
    with progress("recording (s)", round(arguments.for_s)) as advance:
        seconds = record(camera, arguments.out, arguments.for_s, lambda done_s: advance(int(done_s)))
    if arguments.json:
        tell_json({"camera": camera.id, "file": str(arguments.out), "seconds": seconds})
        return 0
    sys.stdout.write(f"{camera.id}: {seconds:.1f} s in {arguments.out}\n")
    return 0


def save_picture(path: Path, picture: object) -> None:
    """Write a BGR picture; raises LumpwatchError."""
    import cv2

    try:
        done, coded = cv2.imencode(path.suffix or ".png", picture)  # type: ignore[call-overload]
    except cv2.error:
        done = False
    if not done:
        raise ConfigError(f"{path}: must end in .png or .jpg")
    try:
        path.write_bytes(coded.tobytes())
    except OSError as error:
        raise LumpwatchError(f"{path}: cannot be written ({error.strerror})") from error
