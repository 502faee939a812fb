"""`lumpwatch replay`: the pipeline on a file."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lumpwatch.service.capture import read_frames
from lumpwatch.service.cli.colours import STYLES
from lumpwatch.service.cli.common import camera_of, progress
from lumpwatch.service.config import CameraConfig, load_config
from lumpwatch.service.core import Frame, RoiResult
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.evidence import read_evidence
from lumpwatch.service.offline import (
    FrameListener,
    ReplayError,
    ReplayShadow,
    RoiSummary,
    Summary,
    load_camera,
    replay_evidence,
    run_replay,
)
from lumpwatch.service.protocol import summary as lines_of
from lumpwatch.service.runtime import check_priors
from lumpwatch.service.storage import PriorStore, ReferenceStore


def replay(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.evidence is not None:
        return _evidence(arguments)
    missing = [name for name in ("config", "video") if getattr(arguments, name) is None]
    if missing:
        raise ConfigError(f"replay needs CONFIG and VIDEO, or --evidence; {missing[0]} is missing")
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    check_priors(config.model_copy(update={"cameras": (camera,)}))
    store = PriorStore(config.store.path, config.store.keep_priors)
    priors = {roi.id: store.current(camera.id, roi.id).prior for roi in camera.rois}
    reference = ReferenceStore(config.store.path, config.store.keep_priors).current(camera.id).reference
    dropped: Counter[str] = Counter()
    frames, length = read_frames(camera, arguments.video, lambda reason: dropped.update([reason]))
    started = time.perf_counter()
    with ExitStack() as stack:
        advance = stack.enter_context(progress("replay", length))
        listeners: list[FrameListener] = [lambda frame, results, pipeline: advance(frame.seq + 1)]
        shadow = None
        if arguments.shadow is not None:
            shadow = ReplayShadow(camera, store, arguments.shadow)
            listeners.append(shadow.watch)
        curves = _plot(arguments, camera, listeners)
        _overlay(arguments, camera, stack, listeners)
        summary = run_replay(
            config.site,
            camera,
            priors,
            frames,
            arguments.video.name,
            arguments.out,
            listeners=listeners,
            reference=reference,
            dropped=dropped,
        )
    if curves is not None:
        curves.save(arguments.out / "existence.png")
    if arguments.json:
        sys.stdout.write(summary.text())
    else:
        _print(summary, arguments.out, time.perf_counter() - started, reference is not None)
    if shadow is not None:
        shadow.save(arguments.out / "shadow.json")
        for state in () if arguments.json else shadow.states():
            print("\n".join(lines_of(state)))  # noqa: T201
    return 0


def _evidence(arguments: argparse.Namespace) -> int:
    """Evidence in the place of a recording."""
    if arguments.config or arguments.video or arguments.camera:
        raise ConfigError("replay --evidence brings its own configuration, prior and camera; leave them out")
    found = read_evidence(arguments.evidence)
    started = time.perf_counter()
    with ExitStack() as stack:
        listeners: list[FrameListener] = []
        curves = _plot(arguments, load_camera(found), listeners)
        _overlay(arguments, load_camera(found), stack, listeners)
        compared = replay_evidence(found, arguments.out, tuple(listeners))
    if curves is not None:
        curves.save(arguments.out / "existence.png")
    if arguments.json:
        sys.stdout.write(compared.summary.text())
    else:
        _print(compared.summary, arguments.out, time.perf_counter() - started, reference=True)
    if compared.equal:
        if not arguments.json:
            print(f"the same decisions as live on all {compared.frames} frames")  # noqa: T201
        return 0
    why = "" if found.meta.exact else " (a tracker's background is not part of evidence)"
    raise ReplayError(
        f"{arguments.evidence}: other decisions than live from frame {compared.same + 1} "
        f"of {compared.frames} on{why}"
    )


def _plot(arguments: argparse.Namespace, camera: CameraConfig, listeners: list[FrameListener]):  # type: ignore[no-untyped-def]
    if not arguments.plot:
        return None
    from lumpwatch.service.offline import ExistenceCurves

    curves = ExistenceCurves({roi.id: roi.alarm.raise_above for roi in camera.rois})

    def watch(frame: Frame, results: tuple[RoiResult, ...], pipeline: CameraPipeline) -> None:
        curves.add(frame.capture_s, results)

    listeners.append(watch)
    return curves


def _overlay(
    arguments: argparse.Namespace, camera: CameraConfig, stack: ExitStack, listeners: list[FrameListener]
) -> None:
    if not arguments.overlay:
        return
    from lumpwatch.service.offline import OverlayVideo

    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReplayError(f"{arguments.out}: cannot be written ({error.strerror})") from error
    overlay = stack.enter_context(OverlayVideo(arguments.out / "overlay.mp4", camera))
    listeners.append(overlay.write)


def _blind(counts: RoiSummary) -> str:
    """Share of the frames, and of each reason."""
    frames = max(counts.frames, 1)
    whole = f"{100 * counts.states['BLIND'] / frames:.1f} %"
    if not counts.blind:
        return whole
    if len(counts.blind) == 1:
        return f"{whole} {next(iter(counts.blind))}"
    parts = ", ".join(f"{reason} {100 * many / frames:.1f}" for reason, many in counts.blind.most_common())
    return f"{whole} ({parts})"


def _alarms(counts: RoiSummary) -> str:
    """How often it was raised, and how often more was announced while it stood."""
    again = counts.transitions["re_alarmed"]
    return f"{counts.transitions['raised']}{f' + {again} again' if again else ''}"


def _print(summary: Summary, out: Path, seconds: float, reference: bool) -> None:
    table = Table(title=f"{summary.video}: {summary.frames} frames, {summary.duration_s:.1f} s")
    found = ["LUMP"]
    if any(counts.states["BLOCKED"] for counts in summary.rois.values()):
        found.append("BLOCKED")
    for heading in ("roi", "alarms", *found, "CLEAR", "BLIND", "most", "prior"):
        table.add_column(heading, header_style=STYLES.get(heading, ""))
    for roi, counts in summary.rois.items():
        share = {
            name: f"{100 * count / max(counts.frames, 1):.1f} %" for name, count in counts.states.items()
        }
        table.add_row(
            roi,
            _alarms(counts),
            *(
                Text(share.get(name, "0 %"), STYLES.get(name, "") if counts.states[name] else "")
                for name in (*found, "CLEAR")
            ),
            Text(_blind(counts), STYLES["BLIND"] if counts.states["BLIND"] else ""),
            f"{counts.highest_existence:.3f}",
            str(counts.prior or "none"),
        )
    console = Console(markup=False)
    console.print(table)
    console.print(
        "alarms: raised; again: one more lump while it stood. LUMP, CLEAR, BLIND: share of the frames. most: highest "
        "existence; prior: version in use",
        style="dim",
        highlight=False,
    )
    for roi, counts in summary.rois.items():
        if counts.paced:
            decided = counts.frames - counts.paced
            console.print(
                f"{roi}: decided on {decided} of {counts.frames} frames (decide_hz)", highlight=False
            )
    if (
        any(counts.blind["hidden"] > 0.1 * counts.frames for counts in summary.rois.values())
        and not reference
    ):
        console.print(
            "BLIND (hidden): without a picture reference even fines on a belt look like a covered lens. Learn one from "
            "footage of a good picture (lumpwatch reference), then replay again.",
            highlight=False,
        )
    console.print(
        f"{summary.frames / max(seconds, 1e-9):.0f} frames a second; results in {out}", highlight=False
    )
