"""Replay of evidence: the same pipeline, from the stored filter state, on the stored frames and times.

Where the evidence is exact, every line of `states.jsonl` comes out as it was decided live, but for what the feed did.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Detection, Frame, PictureQuality
from lumpwatch.service.detection import CameraPipeline, CameraQuality
from lumpwatch.service.evidence import Evidence, EvidenceError, decode_state, read_frames
from lumpwatch.service.offline.replay import FrameListener, Summary, run_replay
from lumpwatch.service.protocol import CAMERA, CLIP, PRIOR, STATE, STATES, TIMES
from lumpwatch.service.storage import Prior, decode_prior


@dataclass(frozen=True, slots=True)
class Compared:
    """A replay beside what was decided live."""

    summary: Summary
    same: int
    """Frames from the first on with the same decision, existence and objects."""
    frames: int

    @property
    def equal(self) -> bool:
        """Whether all of them are."""
        return self.same == self.frames


def load_camera(evidence: Evidence) -> CameraConfig:
    """The camera's configuration at the time, with this ROI alone. Raises EvidenceError."""
    try:
        tree = json.loads(evidence.read(CAMERA))
        tree["source"]["url"] = evidence.meta.name
        return CameraConfig.model_validate(tree)
    except (ValidationError, ValueError, KeyError, TypeError) as error:
        raise EvidenceError(
            f"{evidence.folder / CAMERA}: this version cannot use the configuration of version "
            f"{evidence.meta.software} ({type(error).__name__})"
        ) from error


def load_prior(evidence: Evidence) -> Prior | None:
    """The prior in use at the time. Raises EvidenceError, PriorError."""
    if PRIOR not in evidence.meta.files:
        return None
    prior = decode_prior(evidence.read(PRIOR), str(evidence.folder / PRIOR))
    return prior.with_version(evidence.meta.prior)


class _Recorded(CameraQuality):
    """What was judged of the picture then, in the place of a judgement that lacks the minutes before."""

    def __init__(self, camera: CameraConfig) -> None:
        super().__init__(camera.id, camera.quality, tuple(roi.id for roi in camera.rois))
        self.now = PictureQuality()
        """Of the frame that comes next."""

    def picture(self, frame: Frame, now_s: float) -> None:
        """Known already."""

    def observe(self, roi: str, gray: Image, time_s: float) -> None:
        """Known already."""

    def strangers(self, roi: str, detection: Detection, time_s: float) -> tuple[int, ...]:
        """What was known then."""
        return self.now.standing

    def filtered(self, roi: str, detection: Detection, time_s: float) -> None:
        """Known already."""

    def placed(self, roi_id: str, roi: Roi, width: int, height: int) -> tuple[Roi, tuple[int, int]]:
        """Where the region lay then."""
        x, y = self.now.offset_px
        return roi.at(roi.x + x, roi.y + y), (x, y)

    def current(self, roi: str) -> PictureQuality:
        """What was judged then."""
        return self.now


def replay_evidence(evidence: Evidence, out: Path, listeners: tuple[FrameListener, ...] = ()) -> Compared:
    """Replay it into `out` as any recording, and compare. Raises LumpwatchError."""
    evidence.check()
    meta = evidence.meta
    camera, prior = load_camera(evidence), load_prior(evidence)
    start = decode_state(evidence.read(STATE), str(evidence.folder / STATE), prior)
    decided_s: dict[int, float] = {}
    quality = _Recorded(camera)

    def frames() -> Iterator[Frame]:
        for frame, now_s, current in read_frames(evidence.folder / CLIP, evidence.folder / TIMES):
            decided_s[frame.seq], quality.now = now_s, current
            yield frame

    def prepare(pipeline: CameraPipeline) -> None:
        if meta.exact:
            pipeline.restore(meta.roi, start)

    summary = run_replay(
        meta.site,
        camera,
        {meta.roi: prior},
        frames(),
        meta.name,
        out,
        listeners=listeners,
        prepare=prepare,
        decided_s=lambda frame: decided_s[frame.seq],
        quality=quality,
    )
    live = [_judged(line) for line in evidence.read(STATES).splitlines()]
    again = [_judged(line) for line in (out / "states.jsonl").read_bytes().splitlines()]
    same = next((k for k, (a, b) in enumerate(zip(live, again, strict=False)) if a != b), None)
    return Compared(summary, min(len(live), len(again)) if same is None else same, len(live))


def _judged(line: bytes) -> object:
    """A state line without what the feed did: that follows from pictures before the first that is kept."""
    try:
        state = json.loads(line)
    except ValueError as error:
        raise EvidenceError(f"{STATES}: a line is not JSON") from error
    if isinstance(state, dict):
        state.pop("feed", None)
    return state
