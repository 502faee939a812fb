"""Replay: the live pipeline on a file, as fast as it goes, with everything it decides written down.

The same file, configuration and seed give the same bytes. Times count from the first frame; where a
record wants a date, that is the same number of seconds after 1970-01-01.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import AlarmClass, Clocks, Decision, Frame, RoiResult
from lumpwatch.service.detection import CameraPipeline, CameraQuality, Unobserved
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import alarm_event, feed_of, state_line
from lumpwatch.service.storage import Prior, Reference

SUMMARY = "summary.json"


class ReplayError(LumpwatchError):
    """The replay cannot go on; the text names the file."""


@dataclass(slots=True)
class RoiSummary:
    """What one ROI did over the file."""

    frames: int = 0
    paced: int = 0
    """Frames that were not decided on by rule: what was decided before stood."""
    states: Counter[str] = field(default_factory=Counter)
    feed: Counter[str] = field(default_factory=Counter)
    blind: Counter[str] = field(default_factory=Counter)
    """Frames in which it was BLIND, by reason."""
    transitions: Counter[str] = field(default_factory=Counter)
    highest_existence: float = 0.0
    prior: int = 0


@dataclass(slots=True)
class Summary:
    """What the replay did."""

    site: str
    camera: str
    video: str
    frames: int = 0
    duration_s: float = 0.0
    dropped: Counter[str] = field(default_factory=Counter)
    rois: dict[str, RoiSummary] = field(default_factory=dict)

    def text(self) -> str:
        """As JSON, with stable order."""
        rois = {
            roi: {
                "frames": counts.frames,
                "paced": counts.paced,
                "states": dict(sorted(counts.states.items())),
                "feed": dict(sorted(counts.feed.items())),
                "blind": dict(sorted(counts.blind.items())),
                "alarms": dict(sorted(counts.transitions.items())),
                "highest_existence": round(counts.highest_existence, 6),
                "prior": counts.prior,
            }
            for roi, counts in sorted(self.rois.items())
        }
        content = {
            "site": self.site,
            "camera": self.camera,
            "video": self.video,
            "frames": self.frames,
            "duration_s": round(self.duration_s, 6),
            "dropped": dict(sorted(self.dropped.items())),
            "rois": rois,
        }
        return json.dumps(content, indent=2) + "\n"


class _Drops(Unobserved):
    """Counts what the pipeline did not process."""

    def __init__(self, into: Counter[str], rois: dict[str, RoiSummary]) -> None:
        self._into, self._rois = into, rois

    def paced(self, roi: str) -> None:
        self._rois[roi].paced += 1

    def dropped(self, reason: str) -> None:
        self._into[reason] += 1


FrameListener = Callable[[Frame, tuple[RoiResult, ...], CameraPipeline], None]
"""Is shown every frame with what was decided on it: progress, plots, overlays."""


def run_replay(
    site: str,
    camera: CameraConfig,
    priors: dict[str, Prior | None],
    frames: Iterable[Frame],
    video: str,
    out: Path,
    *,
    listeners: Iterable[FrameListener] = (),
    prepare: Callable[[CameraPipeline], None] = lambda _: None,
    decided_s: Callable[[Frame], float] = lambda frame: frame.received_s,
    reference: Reference | None = None,
    quality: CameraQuality | None = None,
    dropped: Counter[str] | None = None,
) -> Summary:
    """Run the pipeline over `frames` and write states.jsonl, alarms.jsonl and summary.json into `out`.

    `prepare` is shown the pipeline before the first frame; `decided_s` gives the time at which a frame is decided;
    `quality` judges the picture in the place of the pipeline; `dropped` is where the source counts what it could not
    read. Raises ReplayError where `out` cannot be
    written or the file holds no frame, RegionMisfitError where no ROI fits the pictures, and what the
    source raises.
    """
    summary = Summary(site, camera.id, video, rois={roi.id: RoiSummary() for roi in camera.rois})
    if dropped is not None:
        summary.dropped = dropped
    pipeline = CameraPipeline(
        camera, priors, observer=_Drops(summary.dropped, summary.rois), reference=reference, quality=quality
    )
    prepare(pipeline)
    watching = tuple(listeners)
    start_s: float | None = None
    sequences: Counter[str] = Counter()
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / SUMMARY).unlink(missing_ok=True)  # an earlier one would stand beside half of this one
        with (out / "states.jsonl").open("wb") as states, (out / "alarms.jsonl").open("wb") as alarms:
            for frame in frames:
                start_s = frame.capture_s if start_s is None else start_s
                results = pipeline.process(frame, decided_s(frame))
                pipeline.check_fit()
                for result in results:
                    states.write(state_line(result, camera.id, start_s).line() + b"\n")
                    _write_alarms(alarms, result, site, camera.id, sequences, start_s)
                    _add(summary.rois[result.roi], result)
                summary.frames += 1
                summary.duration_s = frame.capture_s - start_s
                for watch in watching:
                    watch(frame, results, pipeline)
        (out / SUMMARY).write_text(summary.text(), encoding="utf-8")
    except OSError as error:
        raise ReplayError(f"{error.filename or out}: cannot be written ({error.strerror})") from error
    if summary.frames == 0:
        raise ReplayError(f"{video}: holds no frame")
    return summary


def _write_alarms(
    file: IO[bytes],
    result: RoiResult,
    site: str,
    camera: str,
    sequences: Counter[str],
    start_s: float,
) -> None:
    if result.frame is None:
        return
    at = Clocks(result.frame.capture_s, result.frame.capture_s - start_s)
    for change in result.changes:
        sequences[result.roi] += 1
        event = alarm_event(result, change, site, camera, sequences[result.roi], at, start_s=start_s)
        file.write(event.line() + b"\n")


def _add(counts: RoiSummary, result: RoiResult) -> None:
    counts.frames += 1
    counts.states[result.decision.value] += 1
    if (feed := feed_of(result)) is not None:
        counts.feed[feed.state.value] += 1
    if result.decision is Decision.BLIND and result.reason is not None:
        counts.blind[result.reason.value] += 1
    counts.highest_existence = max(counts.highest_existence, result.existence)
    counts.prior = result.prior
    for change in result.changes:
        if change.alarm_class in (AlarmClass.LUMP, AlarmClass.BLOCKED):
            counts.transitions[change.transition.change.value] += 1
            break
