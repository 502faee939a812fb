"""Judged alarms as material for training: clips with labels beside them, and clips that show no lump.

    true/CAMERA.ROI.ID.mkv, .txt     confirmed: MOTChallenge boxes of the recorded tracks
    false/CAMERA.ROI.ID.mkv, .txt    false alarms: no box, so that a backtest or a search for hard negatives
                                     takes the clip for one without a lump
    verdicts.json                    what each clip is and who said so

Clips are whole pictures again, black where no region looked; regions cut the same bytes from them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import whole_frame
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import Evidence, read_frames, write_clip, write_video
from lumpwatch.service.offline import load_camera
from lumpwatch.service.protocol import CLIP, STATES, TIMES
from lumpwatch.service.storage import Verdict, VerdictOutcome

_NOTHING = "# a false alarm: no lump\n"


@dataclass(slots=True)
class Exported:
    """What became of the judged alarms."""

    true: int = 0
    false: int = 0
    unsure: int = 0
    without_track: int = 0
    """Confirmed alarms whose evidence holds no track that could be a label."""


def export(judged: Mapping[str, tuple[Evidence, Verdict]], out: Path) -> Exported:
    """Write clips and labels of the evidence by name. Raises LumpwatchError."""
    exported, entries = Exported(), []
    for name, (evidence, verdict) in sorted(judged.items()):
        if verdict.outcome is VerdictOutcome.UNSURE:
            exported.unsure += 1
            continue
        evidence.check()
        labels = _NOTHING
        if verdict.outcome is VerdictOutcome.TRUE:
            labels = track_labels(evidence.read(STATES), load_camera(evidence))
            if not labels:
                exported.without_track += 1
                continue
        base = out / verdict.outcome.value / name.replace("/", ".")
        _write(base, evidence, labels)
        entries.append(_entry(base, out, evidence, verdict))
        if verdict.outcome is VerdictOutcome.TRUE:
            exported.true += 1
        else:
            exported.false += 1
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / "verdicts.json").write_text(json.dumps(entries, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise LumpwatchError(f"{error.filename or out}: cannot be written ({error.strerror})") from error
    return exported


def track_labels(states: bytes, camera: CameraConfig) -> str:
    """MOTChallenge rows of the tracks that at their best would have raised the alarm; frames from 1.

    Raises LumpwatchError for states of a version that wrote others.
    """
    try:
        return _rows([json.loads(line) for line in states.splitlines()], camera)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise LumpwatchError(
            f"camera {camera.id}: the states of evidence cannot be read ({error!r})"
        ) from error


def _rows(lines: list[dict[str, Any]], camera: CameraConfig) -> str:
    best: dict[int, float] = {}
    for line in lines:
        for found in line["objects"]:
            # Written before there was `counts`: all of them did.
            if not found.get("counts", True):
                continue
            best[found["id"]] = max(best.get(found["id"], 0.0), found["existence"])
    above = camera.rois[0].alarm.raise_above
    rows = [
        f"{frame},{found['id']},{found['x']:g},{found['y']:g},{found['w']:g},{found['h']:g},1,1,1\n"
        for frame, line in enumerate(lines, start=1)
        for found in line["objects"]
        if best.get(found["id"], 0.0) > above
    ]
    return "".join(rows)


def _write(base: Path, evidence: Evidence, labels: str) -> None:
    import av.error

    video, text = base.with_name(base.name + ".mkv"), base.with_name(base.name + ".txt")
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        frames = [
            whole_frame(frame) for frame, _, _ in read_frames(evidence.folder / CLIP, evidence.folder / TIMES)
        ]
        if frames[0].encoding == "bgr8":
            write_video(video, [frame.data for frame in frames], frames, "bgr24")
        else:
            write_clip(video, frames)
        text.write_text(labels, encoding="utf-8")
    except (OSError, av.error.FFmpegError) as error:
        raise LumpwatchError(f"{video}: cannot be written ({error.strerror})") from error


def _entry(base: Path, out: Path, evidence: Evidence, verdict: Verdict) -> dict[str, Any]:
    meta = evidence.meta
    return {
        "clip": str(base.relative_to(out)) + ".mkv",
        "labels": str(base.relative_to(out)) + ".txt",
        "verdict": verdict.outcome.value,
        "by": verdict.actor,
        "note": verdict.note,
        "camera": meta.camera,
        "roi": meta.roi,
        "evidence": meta.id,
        "time": meta.time.isoformat(),
        "frames": meta.frames,
    }
