"""What is kept in memory of the last seconds, and the clips that grow out of it when an alarm is raised.

The ring is a row of groups. Each begins with the state of all filters before its first frame, so a clip
that begins with a group can be replayed from there. Nothing here touches a disk or waits: it runs under
the monitor's lock. Frames in the ring take at most `memory_mb`, those in clips twice as much.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from lumpwatch.service.config import EvidenceConfig
from lumpwatch.service.core import AlarmClass, Frame, RoiResult
from lumpwatch.service.protocol import Ended

if TYPE_CHECKING:
    from lumpwatch.service.detection import Snapshot

STATE_EVERY_S = 1.0
"""How often the state of the filters is kept."""
_MIB = 1 << 20


class EvidenceObserver(Protocol):
    """Counts what happens to evidence; implemented by metrics."""

    def evidence_written(self, roi: str) -> None:
        """A clip with all that belongs to it is on the disk."""

    def evidence_problem(self, reason: str) -> None:
        """`memory`, `unwritable` or `disk_full`."""

    def evidence_removed(self, reason: str, count: int) -> None:
        """`age` or `space`."""

    def evidence_stored(self, size: int) -> None:
        """Bytes of this camera's evidence on the disk."""

    def pre_roll(self, seconds: float) -> None:
        """How much lies in memory."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame with what was decided on it."""

    frame: Frame
    now_s: float
    """When it was decided, monotonic clock."""
    results: tuple[RoiResult, ...]

    def result(self, roi: str) -> RoiResult:
        """What was decided for that ROI."""
        return next(result for result in self.results if result.roi == roi)


@dataclass(frozen=True, slots=True)
class Trigger:
    """The alarm that a clip is evidence of."""

    id: str
    """Id of its record, and of the evidence."""
    roi: str
    alarm_class: AlarmClass
    sequence: int
    wall_s: float
    now_s: float


@dataclass(frozen=True, slots=True)
class Clip:
    """A clip that is complete."""

    trigger: Trigger
    start: Snapshot
    """State before the first frame."""
    kept: tuple[Moment, ...]
    decisive: int
    """Index of the frame that raised the alarm; for a blind alarm, of the last one before it."""
    ended: Ended

    @property
    def size(self) -> int:
        """Bytes of the frames."""
        return sum(moment.frame.data.nbytes for moment in self.kept)


@dataclass(slots=True)
class _Group:
    before: Mapping[str, Snapshot]
    kept: list[Moment] = field(default_factory=list)
    size: int = 0


@dataclass(slots=True)
class _Recording:
    trigger: Trigger
    start: Snapshot
    kept: list[Moment]
    decisive: int
    size: int


class Recorder:
    """The ring and the running clips of one camera."""

    def __init__(
        self,
        config: EvidenceConfig,
        observer: EvidenceObserver,
        submit: Callable[[Clip], None],
        waiting: Callable[[], int],
    ) -> None:
        """Complete clips go to `submit`; `waiting` gives the bytes of those that are not written yet."""
        self._config = config
        self._observer = observer
        self._submit = submit
        self._waiting = waiting
        self._groups: deque[_Group] = deque()
        self._running: list[_Recording] = []
        self._shape: tuple[object, ...] | None = None

    def wants_state(self, frame: Frame) -> bool:
        """Whether `add` needs the filters' state before this frame."""
        if not self._config.enabled:
            return False
        shape = (frame.data.shape, frame.encoding, frame.crop, frame.reduction, frame.width, frame.height)
        if shape != self._shape:
            self.restart()
            self._shape = shape
        return not self._groups or self._since_state(frame) >= STATE_EVERY_S

    def add(self, kept: Moment, before: Mapping[str, Snapshot] | None) -> None:
        """The next frame; with the state before it, where `wants_state` asked for it."""
        if not self._config.enabled:
            return
        if before is not None and self._may_begin(kept):
            self._groups.append(_Group(before))
        group = self._groups[-1]
        size = kept.frame.data.nbytes
        group.kept.append(kept)
        group.size += size
        for recording in tuple(self._running):
            if self.clips_size + size > 2 * self._config.memory_mb * _MIB:
                self._observer.evidence_problem("memory")
                self._finish(recording, "memory")
            else:
                recording.kept.append(kept)
                recording.size += size
        self._trim(kept.frame.capture_s)
        self.tick(kept.now_s)

    def _may_begin(self, kept: Moment) -> bool:
        """Whether a group begins: with a frame that was decided on, where one comes in time.

        On others what was decided before stands, which the filters' state does not hold.
        """
        if not self._groups or all(result.decided for result in kept.results):
            return True
        return self._since_state(kept.frame) >= 2 * STATE_EVERY_S

    def _since_state(self, frame: Frame) -> float:
        """Seconds since the frame before which the state was kept last."""
        return frame.capture_s - self._groups[-1].kept[0].frame.capture_s

    def wants(self, trigger: Trigger) -> bool:
        """Whether `begin` would begin a clip."""
        return self._of_a_class(trigger) and self._fits()

    def begin(self, trigger: Trigger) -> bool:
        """Begin a clip with what is in the ring; whether there will be evidence."""
        if not self._of_a_class(trigger):
            return False
        if not self._fits():
            self._observer.evidence_problem("memory")
            return False
        size = self.ring_size
        kept = [moment for group in self._groups for moment in group.kept]
        start = self._groups[0].before[trigger.roi]
        self._running.append(_Recording(trigger, start, kept, len(kept) - 1, size))
        return True

    def tick(self, now_s: float) -> None:
        """Finish the clips whose post-roll is over, also while no frames come."""
        for recording in tuple(self._running):
            if now_s - recording.trigger.now_s >= self._config.post_roll_s:
                self._finish(recording, "post_roll")

    def restart(self, ended: Ended = "changed") -> None:
        """What comes from now on does not go on from what was before, as when a prior is taken."""
        for recording in tuple(self._running):
            self._finish(recording, ended)
        self._groups.clear()

    def _finish(self, recording: _Recording, ended: Ended) -> None:
        self._running.remove(recording)
        kept = tuple(recording.kept)
        self._submit(Clip(recording.trigger, recording.start, kept, recording.decisive, ended))

    def _of_a_class(self, trigger: Trigger) -> bool:
        return trigger.alarm_class.value in self._config.classes and bool(self._groups)

    def _fits(self) -> bool:
        return self.clips_size + self.ring_size <= 2 * self._config.memory_mb * _MIB

    @property
    def ring_frames(self) -> int:
        """How many frames are in the ring."""
        return sum(len(group.kept) for group in self._groups)

    @property
    def ring_size(self) -> int:
        """Bytes of the frames in the ring."""
        return sum(group.size for group in self._groups)

    @property
    def clips_size(self) -> int:
        """Bytes of the clips that run and of those that wait to be written."""
        return self._waiting() + sum(recording.size for recording in self._running)

    def _trim(self, newest_s: float) -> None:
        groups = self._groups
        size = sum(group.size for group in groups)
        while groups and (
            size > self._config.memory_mb * _MIB
            or (len(groups) > 1 and groups[1].kept[0].frame.capture_s <= newest_s - self._config.pre_roll_s)
        ):
            size -= groups.popleft().size
        self._observer.pre_roll(newest_s - groups[0].kept[0].frame.capture_s if groups else 0.0)
