"""How many cameras like this one a machine carries, by the CPU time of the real chain on a clip of it.

The work of the camera's and of the monitor's process is done in this one, in their order and with a bus between:
decode, choose and cut, publish, take, judge the picture, filter, publish the state. CPU time is that of all
threads, so other work on the machine changes it little. Bare decoding takes turns with it on the same clip.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from statistics import median

import av

from lumpwatch.service.bus import Bus, FrameInbox, Keys, open_client, open_hub
from lumpwatch.service.capture import Reducer, read_frames
from lumpwatch.service.config import BusConfig, CameraConfig
from lumpwatch.service.core import Clocks, Frame
from lumpwatch.service.detection import CameraPipeline, Unobserved
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import state_message
from lumpwatch.service.storage import Prior

ROUNDS = 3
USABLE = 0.8
"""Share of the processors that may be planned with: what is left is for alarms, clips, scrapes and the system."""
_PIPELINE = "pipeline"
_TRIALS, _TAKE_S = 10, 1.0


@dataclass(frozen=True, slots=True)
class Cost:
    """What one camera takes. Times are CPU time."""

    width: int
    height: int
    fps: float
    """Frames a second in the clip."""
    decided_hz: float
    """Frames a second that any region was decided on; the others are decoded and passed over."""
    decoding_ms: float
    """Bare decoding of a frame."""
    frame_ms: float
    """The whole chain, a frame of the camera."""
    stages_ms: Mapping[str, float]
    """The chain by its stages, a frame of the camera; `other` is what threads of the bus and the rest take."""
    shared_memory: bool
    """Whether frames went through shared memory."""

    @property
    def ratio(self) -> float:
        """The chain in units of bare decoding."""
        return self.frame_ms / self.decoding_ms

    @property
    def share(self) -> float:
        """Of one processor, at the camera's own rate."""
        return self.frame_ms * self.fps / 1000.0

    def carried(self, processors: int) -> int:
        """So many such cameras leave a fifth of the machine free."""
        return int(USABLE * processors / self.share)


def measure_cost(
    camera: CameraConfig,
    priors: Mapping[str, Prior | None],
    clip: Path,
    seconds: float,
    advance: Callable[[int], None] = lambda _: None,
) -> Cost:
    """Measure the chain of a camera on the first seconds of a clip. `advance` is told the rounds that are done.

    Raises LumpwatchError for a clip that cannot be read or is too short.
    """
    config = BusConfig(listen=("tcp/127.0.0.1:0",))
    with open_hub(config) as hub:
        joined = BusConfig(mode="client", connect=hub.endpoints)
        with open_client(joined) as sending, open_client(joined) as taking:
            chain = _Chain(camera, priors, sending, taking)
            chain.run(clip, min(seconds, 2.0))  # compiles kernels, and fills the caches
            bare, whole, stages = [], [], []
            for done in range(ROUNDS):
                bare.append(_decode(clip, seconds))
                began = time.process_time()
                passed = chain.run(clip, seconds)
                whole.append((time.process_time() - began) / passed.frames)
                stages.append(passed)
                advance(done + 1)
    best = stages[whole.index(sorted(whole)[len(whole) // 2])]
    frame_ms = 1000.0 * median(whole)
    told = {name: 1000.0 * spent / best.frames for name, spent in best.spent.items()}
    return Cost(
        best.size[0],
        best.size[1],
        best.fps,
        best.decided * best.fps / best.frames,
        1000.0 * median(bare),
        frame_ms,
        told | {"other": max(frame_ms - sum(told.values()), 0.0)},
        bool(best.shared_memory),
    )


def _decode(clip: Path, seconds: float) -> float:
    """CPU time of decoding a frame to its luma plane, with nothing else."""
    began, frames = time.process_time(), 0
    with av.open(f"file:{clip}") as container:
        container.streams.video[0].thread_type = "NONE"
        for picture in container.decode(video=0):
            if picture.time is not None and picture.time >= seconds:
                break
            memoryview(picture.planes[0])
            frames += 1
    return (time.process_time() - began) / max(frames, 1)


@dataclass(slots=True)
class _Passed:
    """One run over a clip."""

    spent: dict[str, float] = field(default_factory=dict)
    """CPU seconds of this thread by stage."""
    frames: int = 0
    decided: int = 0
    size: tuple[int, int] = (0, 0)
    fps: float = 0.0
    shared_memory: bool | None = None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        began = time.thread_time()
        yield
        self.spent[name] = self.spent.get(name, 0.0) + time.thread_time() - began


class _Inside(Unobserved):
    """What the pipeline takes for its parts, in shares: it times them by the clock on the wall."""

    def __init__(self) -> None:
        self._seen: dict[str, float] = {}

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """A part of the work on one region of one frame."""
        name = "cut regions" if stage == "cut" else stage
        self._seen[name] = self._seen.get(name, 0.0) + seconds

    def divide(self, spent: dict[str, float]) -> None:
        """Put the parts in the place of the whole."""
        whole, total = spent.pop(_PIPELINE, 0.0), sum(self._seen.values())
        for name, seconds in self._seen.items():
            spent[name] = whole * seconds / total


class _Chain:
    """Both processes of a camera in one."""

    def __init__(
        self, camera: CameraConfig, priors: Mapping[str, Prior | None], sending: Bus, taking: Bus
    ) -> None:
        self._camera, self._priors = camera, dict(priors)
        keys = Keys("bench")
        self._inbox: FrameInbox = taking.frame_inbox(keys.frame(camera.id))
        self._frames = sending.frame_publisher(keys.frame(camera.id))
        self._states = {roi.id: taking.publisher(keys.state(camera.id, roi.id)) for roi in camera.rois}

    def run(self, clip: Path, seconds: float) -> _Passed:
        """Everything on the first seconds of the clip. Raises LumpwatchError."""
        passed, times = _Passed(), []
        inside = _Inside()
        reduce = Reducer(self._camera)
        pipeline = CameraPipeline(self._camera, self._priors, observer=inside)
        frames, _ = read_frames(self._camera, clip)
        coming = takewhile(lambda one: one.capture_s < seconds, frames)
        while True:
            with passed.stage("decode"):
                frame = next(coming, None)
            if frame is None:
                break
            passed.frames, passed.size = passed.frames + 1, (frame.width, frame.height)
            times.append(frame.capture_s)
            if not reduce.is_due(frame):
                continue
            passed.decided += 1
            with passed.stage("cut"):
                cut = reduce(frame)
            self._decide(self._sent(cut, passed), pipeline, passed)
        frames.close()
        if len(times) < 20 or times[-1] <= times[0]:
            raise LumpwatchError(f"{clip}: {len(times)} frames are too few to measure by")
        passed.fps = (len(times) - 1) / (times[-1] - times[0])
        passed.shared_memory = self._inbox.through_shared_memory
        inside.divide(passed.spent)
        return passed

    def _sent(self, frame: Frame, passed: _Passed) -> Frame:
        """The frame after its way through the bus."""
        for _ in range(_TRIALS):  # the first ones are sent before the bus knows who listens
            with passed.stage("publish"):
                self._frames.publish(frame, self._camera.wire.encoding)
            with passed.stage("take"):
                taken = self._inbox.take(_TAKE_S)
            if taken is not None:
                return taken
        raise LumpwatchError(f"camera {self._camera.id}: a frame did not come through the bus")

    def _decide(self, frame: Frame, pipeline: CameraPipeline, passed: _Passed) -> None:
        with passed.stage(_PIPELINE):
            results = pipeline.process(frame, frame.received_s)
        with passed.stage("state"):
            clocks = Clocks(frame.received_s, frame.received_s)
            for result in results:
                message = state_message(result, "bench", self._camera.id, clocks)
                self._states[result.roi].put(message.line())
