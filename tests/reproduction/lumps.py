"""Lumps announced and false alarms raised on simulated feeds, for states as `replay` writes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from service.config import CameraConfig
from service.feed.simulator import FeedSimulator
from service.feed.spec import FeedSpec
from service.frames import Frame
from service.labels import Box, read_labels
from service.messages import Decision, StateLine
from service.pipeline import CameraPipeline
from service.store.prior import Prior


@dataclass(frozen=True, slots=True)
class Announcement:
    """What became of one lump that fell."""

    lump: int
    first_frame: int
    fall_frame: int
    warned_s: float | None
    """Seconds before its fall at which the ROI first said LUMP with the estimate on this lump."""


def read_states(path: Path) -> list[StateLine]:
    """The lines of a `states.jsonl`."""
    return [StateLine.model_validate_json(line) for line in path.read_bytes().splitlines()]


def announcements(states: list[StateLine], labels: Path, fps: float) -> list[Announcement]:
    """One entry for each lump whose fall the labels show."""
    boxes: dict[int, list[Box]] = {}
    for box in read_labels(labels):
        boxes.setdefault(box.track, []).append(box)
    by_frame = {state.frame: state for state in states}
    found = []
    for lump, track in sorted(boxes.items()):
        falls = [box.frame for box in track if box.model == "fall"]
        if not falls:
            continue
        warned = [
            box.frame
            for box in track
            if box.frame < falls[0] and (state := by_frame.get(box.frame)) is not None and _says(state, box)
        ]
        lead = (falls[0] - warned[0]) / fps if warned else None
        found.append(Announcement(lump, track[0].frame, falls[0], lead))
    return found


def _says(state: StateLine, box: Box) -> bool:
    """Whether the state is LUMP and its estimate lies on this box (intersection over union above 0.3)."""
    if state.state is not Decision.LUMP:
        return False
    for found in state.objects:
        w = min(found.x + found.w, box.x + box.w) - max(found.x, box.x)
        h = min(found.y + found.h, box.y + box.h) - max(found.y, box.y)
        common = max(w, 0.0) * max(h, 0.0)
        if common > 0.3 * (found.w * found.h + box.w * box.h - common):
            return True
    return False


def alarms_on(camera: CameraConfig, prior: Prior, spec: FeedSpec, seconds: float) -> int:
    """How often the alarm was raised on a feed, rendered frame by frame."""
    roi = camera.rois[0].id
    pipeline = CameraPipeline(camera, {roi: prior})
    raised = 0
    for frame in feed_frames(spec, seconds):
        for result in pipeline.process(frame, frame.received_s):
            raised += result.transition is not None and result.transition.change == "raised"
    return raised


def feed_frames(spec: FeedSpec, seconds: float) -> Iterator[Frame]:
    """The frames of a feed with times from its start."""
    feed = FeedSimulator(spec)
    for i in range(round(seconds * spec.fps)):
        t = i / spec.fps
        yield Frame(i, t, t, t, spec.width, spec.height, "gray8", feed.render()[0])
