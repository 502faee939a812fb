"""What the event logs hold of a shift, put together alarm by alarm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import AlarmClass, Change
from lumpwatch.service.shift.window import Window
from lumpwatch.service.storage import (
    Event,
    Span,
    Verdict,
    event_file,
    latest_verdicts,
    read_events,
    reading,
    uptime_spans,
)

_HOLDS = frozenset({Change.SHELVED.value, Change.SUPPRESSED.value, Change.TAKEN_OUT.value})
Place = tuple[str, str]
"""Camera and ROI."""


@dataclass(slots=True)
class AlarmStory:
    """A lump from its first announcement on: what is announced again while it is there stays one story."""

    raised: Event
    acknowledged: Event | None = None
    cleared: Event | None = None
    verdict: Verdict | None = None
    again: list[Event] = field(default_factory=list)
    """Later announcements of the same lump."""
    held: bool = False
    """Whether the alarm was shelved, suppressed or out of service since."""

    def number(self, name: str) -> float | None:
        """A detail as it was known last: sizes when it was cleared, else when it was raised."""
        later = self.cleared.details.get(name) if self.cleared is not None and name != "lip_s" else None
        value = self.raised.details.get(name) if later is None else later
        return float(value) if isinstance(value, int | float) else None

    @property
    def acknowledged_after_s(self) -> float | None:
        """Seconds from raising to acknowledgement; None: nobody has."""
        return _between(self.raised, self.acknowledged)

    @property
    def lasted_s(self) -> float | None:
        """Seconds until the condition was over; None: it is not."""
        return _between(self.raised, self.cleared)

    @property
    def evidence(self) -> str | None:
        """Id of its evidence."""
        found = self.raised.details.get("evidence")
        return found if isinstance(found, str) else None


@dataclass(slots=True)
class RoiRecord:
    """What a shift holds of one ROI."""

    place: Place
    alarms: list[AlarmStory] = field(default_factory=list)
    """Of class lump, raised in the shift."""
    blind_alarms: int = 0
    """Raised in the shift."""
    held: int = 0
    """Lumps that came while the alarm was shelved, suppressed or out of service."""
    spans: list[Span] = field(default_factory=list)


def read_shift(config: SiteConfig, window: Window) -> list[RoiRecord]:
    """All ROIs of the configuration, in its order. Raises EventLogError."""
    records = []
    for camera in config.cameras:
        path = event_file(config.store.path, camera.id)
        events: list[Event] = []
        uptime: list[Span] = []
        verdicts: dict[tuple[str, str], Verdict] = {}
        if path.is_file():
            events = list(read_events(path, window.begin_s))
            with reading(path) as db:
                uptime = list(uptime_spans(db, window.begin_s, window.end_s))
                verdicts = latest_verdicts(db)
        for roi in camera.rois:
            own = [event for event in events if event.roi == roi.id]
            record = roi_record((camera.id, roi.id), own, window, verdicts)
            record.spans = [span for span in uptime if span.roi == roi.id]
            records.append(record)
    return records


def roi_record(
    place: Place, events: Sequence[Event], window: Window, verdicts: dict[tuple[str, str], Verdict]
) -> RoiRecord:
    """From the events of a ROI, those after the shift included: an alarm may be acknowledged later."""
    record = RoiRecord(place)
    in_shift = [event for event in events if window.begin_s <= event.time_s < window.end_s]
    raised = Change.RAISED.value
    record.blind_alarms = sum(
        event.change == raised and event.alarm_class is AlarmClass.BLIND for event in in_shift
    )
    record.held = sum(
        event.change == Change.ACTIVE.value and event.alarm_class is AlarmClass.LUMP for event in in_shift
    )
    stories = _stories(event for event in events if event.alarm_class is AlarmClass.LUMP)
    for story in stories:
        said = [verdicts.get((place[1], event.id)) for event in (*reversed(story.again), story.raised)]
        story.verdict = next((verdict for verdict in said if verdict is not None), None)
    record.alarms = [story for story in stories if window.begin_s <= story.raised.time_s < window.end_s]
    return record


def _stories(events: Iterable[Event]) -> list[AlarmStory]:
    stories: list[AlarmStory] = []
    for event in events:
        if event.change == Change.RAISED.value:
            # The end of a hold raises what is still there anew: the lump is the same. What comes after the condition
            # was over for the off-delay counts as another one.
            if stories and stories[-1].cleared is None and stories[-1].held:
                stories[-1].again.append(event)
            else:
                stories.append(AlarmStory(event))
        elif stories:
            last = stories[-1]
            last.held |= event.change in _HOLDS
            if event.change == Change.ACKNOWLEDGED.value and last.acknowledged is None:
                last.acknowledged = event
            elif event.change in (Change.CLEARED.value, Change.INACTIVE.value) and last.cleared is None:
                last.cleared = event
    return stories


def _between(first: Event, then: Event | None) -> float | None:
    """By the monotonic clock where both times are by the same one: the wall clock may be stepped."""
    if then is None:
        return None
    if first.clock == then.clock:
        return then.monotonic_s - first.monotonic_s
    return max(0.0, then.time_s - first.time_s)
