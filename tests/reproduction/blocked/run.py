"""One feed through the pipeline and both peers: what each said and when, beside the truth."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    AlarmClass,
    BlindReason,
    Change,
    DetectedObject,
    Detection,
    FeedState,
    Frame,
)
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from tests.reproduction.blocked.peers import Peer, peers

DELAY_S = 8.0
ABOVE = 0.25


class Followed:
    """A detector that follows every lump of the truth: what is measured is the mouth, not the filter of the belt."""

    learns = False

    def __init__(self, roi: Roi) -> None:
        self.roi = roi
        self.now = Detection(0.0, ())

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        return self.now

    def use(self, learned: object) -> None:
        pass

    def clouds(self) -> tuple[Belief, ...]:
        return ()

    def state(self) -> None:
        return None

    def restore(self, state: object) -> None:
        raise NotImplementedError


@dataclass(slots=True)
class Run:
    """What happened in one feed; seconds from its start."""

    seconds: float
    blocked: list[tuple[float, float]] = field(default_factory=list)
    """From when on enough stood while the feed ran, and when it broke."""
    ran_s: list[float] = field(default_factory=list)
    """For how long the feed ran in each of them."""
    raised: dict[str, list[float]] = field(default_factory=dict)
    """Of each method, when it raised its alarm."""
    said: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    """Of each method, from when to when it called the mouth blocked."""
    known_s: float = 0.0
    """From when on the mouth was known; until then its region is BLIND, and says so."""
    blind_s: float = 0.0
    moving: dict[str, list[tuple[float, bool]]] = field(default_factory=dict)
    """Of each peer: how much moved, and whether the mouth was blocked; for tuning."""

    def plain(self) -> dict[str, Any]:
        """As JSON has it, without what is for tuning."""
        return {key: value for key, value in asdict(self).items() if key != "moving"}


def camera_of(feed: FeedSimulator) -> CameraConfig:
    """A belt and its mouth, with the default keys.

    But for one that costs a third of the time: whether what is followed on the belt stands there is not asked, since
    what is followed here are lumps.
    """
    rois = [
        {"id": "apron", "polygon": feed.belt_polygon, "alarm": {"on_delay_s": 0.0}},
        {"id": "mouth", "watch": "mouth", "polygon": feed.mouth_polygon, "mouth": {"belt": "apron"}},
    ]
    quality = {"hidden": {"standing": False}}
    return CameraConfig.model_validate(
        {"id": "cam", "source": {"url": "sim:feed"}, "rois": rois, "quality": quality}
    )


class _Says:
    """When one method calls the mouth blocked."""

    def __init__(self, found: Run, name: str) -> None:
        self._raised = found.raised.setdefault(name, [])
        self._said = found.said.setdefault(name, [])
        self._since: float | None = None

    def step(self, t: float, *, raises: bool, blocked: bool) -> None:
        if raises:
            self._raised.append(t)
        if blocked and self._since is None:
            self._since = t
        if not blocked and self._since is not None:
            self._said.append((self._since, t))
            self._since = None


def run(spec: FeedSpec, seconds: float, limits: dict[str, float] | None = None) -> Run:
    """All of it. `limits` are the peers' thresholds; None: they are only observed."""
    feed = FeedSimulator(spec)
    made: list[Followed] = []

    def make(config: object, roi: Roi, learned: object) -> Followed:
        made.append(Followed(roi))
        return made[-1]

    pipeline = CameraPipeline(camera_of(feed), make=make)
    others = peers(feed.mouth_polygon, spec.width, spec.height, limits)
    found = Run(seconds)
    says = {name: _Says(found, name) for name in ("lumpwatch", *(peer.name for peer in others))}
    for peer in others:
        found.moving[peer.name] = []
    since: float | None = None
    for k in range(round(seconds * spec.fps)):
        t = feed.time_s
        picture, truths = feed.render()
        lumps = tuple(
            DetectedObject(one.id, one.x, one.y, one.w, one.h, 1.0, 1.0, 0.99, "belt")
            for one in truths
            if one.on_belt
        )
        if made:
            made[-1].now = Detection(0.99 if lumps else 0.0, lumps)
        results = {one.roi: one for one in pipeline.process(_frame(k, t, picture, spec), t)}
        mouth = results["mouth"]
        raises = any(
            change.alarm_class is AlarmClass.BLOCKED and change.transition.change is Change.RAISED
            for change in mouth.changes
        )
        says["lumpwatch"].step(t, raises=raises, blocked=mouth.alarms[AlarmClass.BLOCKED].active)
        if mouth.reason is BlindReason.STARTING:
            found.known_s = t + 1.0 / spec.fps
        found.blind_s += (mouth.reason is not None) / spec.fps
        state = mouth.feed.state if mouth.feed is not None else FeedState.UNKNOWN
        runs = state in (FeedState.RUNNING, FeedState.UNKNOWN)
        since = _follow(found, feed, t, since)
        for peer in others:
            moving = peer.step(picture, t, runs=runs)
            found.moving[peer.name].append((moving, since is not None))
            says[peer.name].step(t, raises=peer.raises, blocked=peer.active)
    for one in says.values():
        one.step(seconds, raises=False, blocked=False)
    if since is not None:
        found.blocked.append((since, seconds))
    return found


def _follow(found: Run, feed: FeedSimulator, t: float, since: float | None) -> float | None:
    """Since when the mouth has been blocked, now; what is over is noted."""
    truth = feed.mouth_at(t)
    lodged = [at for _, at, until in feed.lodged if at <= t < until]
    runs = feed.belt_at(t).speed_mm_s > 0.5 * feed.spec.belt_speed_mm_s
    blocked = (truth.bridged and truth.standing >= ABOVE) or bool(lodged)
    if blocked and since is None and runs:
        found.ran_s.append(0.0)
        return min([*lodged, t]) if lodged else t
    if since is not None:
        found.ran_s[-1] += runs / feed.spec.fps
    if not blocked and since is not None:
        found.blocked.append((since, t))
        return None
    return since


def _frame(k: int, t: float, picture: Image, spec: FeedSpec) -> Frame:
    return Frame(k, t, t, t, spec.width, spec.height, "gray8", np.ascontiguousarray(picture))


__all__ = ["DELAY_S", "Peer", "Run", "run"]
