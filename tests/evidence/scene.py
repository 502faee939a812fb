"""A monitor's pipeline with its recorder, fed by hand: what the tests of evidence share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.config.evidence import EvidenceConfig
from lumpwatch.service.core.alarm import AlarmClass, Change
from lumpwatch.service.core.clock import Clocks
from lumpwatch.service.core.decision import RoiResult
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.evidence.files import write_files
from lumpwatch.service.evidence.folder import Evidence, read_evidence
from lumpwatch.service.evidence.recorder import Clip, Moment, Recorder, Trigger
from lumpwatch.service.protocol.records import record_id
from lumpwatch.service.storage.prior_file import Prior
from tests.service_helpers import HEIGHT, INTERVAL_S, WIDTH, frame

WALL_S = 1.7e9
BEGAN_S = 1000.0
"""Where the monotonic clock of the scenes begins."""
LATENCY_S = 0.0123


class Counting:
    """Counts what evidence says of itself."""

    def __init__(self) -> None:
        self.written: Counter[str] = Counter()
        self.problems: Counter[str] = Counter()
        self.removed: Counter[str] = Counter()
        self.stored = 0
        self.pre_roll_s = 0.0

    def evidence_written(self, roi: str) -> None:
        self.written[roi] += 1

    def evidence_problem(self, reason: str) -> None:
        self.problems[reason] += 1

    def evidence_removed(self, reason: str, count: int) -> None:
        self.removed[reason] += count

    def evidence_stored(self, size: int) -> None:
        self.stored = size

    def pre_roll(self, seconds: float) -> None:
        self.pre_roll_s = seconds


def moving(index: int, *, visible: bool, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """Noise of its own in each frame, and a white square that moves down."""
    noise = np.random.default_rng(1000 + index).integers(10, 60, (height, width)).astype(np.uint8)
    if visible:
        top = 8 + index % 30
        noise[top : top + 14, 41:55] = 250
    return noise


class Scene:
    """A camera whose frames are decided, recorded and, where an alarm is raised, become clips."""

    def __init__(
        self,
        camera: CameraConfig,
        priors: dict[str, Prior | None] | None = None,
        config: EvidenceConfig | None = None,
        *,
        submit: Callable[[Clip], None] | None = None,
        waiting: Callable[[], int] | None = None,
    ) -> None:
        """Finished clips go to `submit`; without it, to `clips`."""
        self.camera = camera
        self.pipeline = CameraPipeline(camera, priors)
        self.counting = Counting()
        self.clips: list[Clip] = []
        self.waiting = 0
        self.config = config or EvidenceConfig(pre_roll_s=2.0, post_roll_s=1.0)
        self.recorder = Recorder(
            self.config, self.counting, submit or self.clips.append, waiting or (lambda: self.waiting)
        )
        self.index = 0
        self.sequence = 0
        self.live: list[RoiResult] = []

    def show(self, seconds: float, picture: Callable[[int], NDArray[np.uint8]], **more: Any) -> None:
        """So many frames of what `picture` makes of their index."""
        for _ in range(round(seconds / INTERVAL_S)):
            k = self.index
            self.feed(frame(k, time_s=BEGAN_S + k * INTERVAL_S + 0.003 * (k % 3), data=picture(k), **more))

    def feed(self, one: Frame) -> None:
        self.index += 1
        now_s = one.received_s + LATENCY_S
        before = self.pipeline.snapshots() if self.recorder.wants_state(one) else None
        results = self.pipeline.process(one, now_s)
        self.recorder.add(Moment(one, now_s, results), before)
        self.told(results, now_s)

    def told(self, results: tuple[RoiResult, ...], now_s: float) -> None:
        self.live += results
        for result in results:
            for change in result.changes:
                if change.transition.change is Change.RAISED:
                    self.begin(result.roi, change.alarm_class, now_s)

    def begin(self, roi: str, alarm_class: AlarmClass, now_s: float) -> bool:
        self.sequence += 1
        clocks = Clocks(now_s, WALL_S + now_s)
        name = record_id(clocks, self.sequence)
        return self.recorder.begin(Trigger(name, roi, alarm_class, self.sequence, clocks.wall_s, now_s))


def written(clip: Clip, camera: CameraConfig, folder: Path) -> Evidence:
    """The clip as files."""
    folder.mkdir(parents=True)
    write_files(folder, clip, "pit", camera, "1.2.3")
    return read_evidence(folder)
