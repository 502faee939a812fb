"""`lumpwatch proof`: test a running daemon with a synthetic lump."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import Commands, add_actor, add_command
from lumpwatch.service.config import load_config
from lumpwatch.service.protocol import Outcome, ProofResult

_PATIENCE_S = 300.0


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "proof",
        proof,
        "Test a running daemon: a synthetic lump is blended into the real frames and must come out as an "
        "alarm on the test key. Exit code 1 where any test does not pass.",
        "lumpwatch proof site.yaml --camera crusher-1 --roi apron",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="this camera only")
    parser.add_argument("--roi", metavar="ID", help="this ROI of the camera only (with --camera)")
    add_actor(parser, "who asks; it is recorded", required=False)
    parser.add_argument("--json", action="store_true", help="print the results as they are, one a line")


def proof(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    cameras = config.cameras if arguments.camera is None else (camera_of(config, arguments.camera),)
    keys, passed = Keys(config.site), True
    shown: dict[str, None] = {}
    with open_client(as_client(config.bus), wait=False) as bus:
        for camera in cameras:
            rois = camera.rois if arguments.roi is None else (roi_of(camera, arguments.roi),)
            for roi in rois:
                target = f"{camera.id}/{roi.id}"
                key = keys.command(camera.id, roi.id, "proof")
                answer = ask_one(bus, key, {"actor": arguments.actor}, target, _PATIENCE_S)
                result = read_answer(ProofResult, answer, target)
                passed &= result.outcome is Outcome.PASSED
                sys.stdout.write((answer.decode() if arguments.json else describe(result)) + "\n")
                sys.stdout.flush()
                shown[result.shows] = None
    if not arguments.json:
        sys.stdout.write("".join(f"{words}\n" for words in shown))
    return 0 if passed else 1


def describe(result: ProofResult) -> str:
    """One line for a person."""
    why = f" ({result.reason.value})" if result.reason else ""
    warning = "no alarm" if result.warning_s is None else f"{result.warning_s:.1f} s of warning"
    return (
        f"{result.camera}/{result.roi}: {result.outcome.value}{why}, {warning}, "
        f"existence up to {result.existence:.2f}, prior {result.prior}, {result.lump or 'a drawn lump'}"
    )
