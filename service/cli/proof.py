"""`lumpwatch proof`: test a running daemon with a synthetic lump."""

from __future__ import annotations

import argparse
import sys

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.config import load_config
from lumpwatch.service.protocol import Outcome, ProofResult

_PATIENCE_S = 300.0


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
