"""The dead man's switch of whoever follows the bus: when nothing valid is heard of a camera, and when again.

The follower counts on its own monotonic clock from the moment at which a heartbeat came. One that says that it is
not valid counts like none.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime

from pydantic import ValidationError

from lumpwatch.service.protocol.messages import Heartbeat

VALID_S = 3.0
"""Levels and heartbeats that are older are no longer valid; so long a follower waits for the first one."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A camera of which nothing valid is heard any more, or is heard again."""

    site: str
    camera: str
    silent: bool
    """False: it is heard again."""
    for_s: float
    """Seconds since the last valid heartbeat; when it is heard again, seconds that nothing was."""
    reason: str
    """`never_heard`, `not_heard` or `not_valid`; empty when it is heard again."""

    def line(self, time: datetime) -> bytes:
        """A CloudEvents 1.0 record in one line of JSON, so that it fits between alarm records."""
        change = "began" if self.silent else "ended"
        return json.dumps(
            {
                "specversion": "1.0",
                "id": f"{self.camera}-silence-{change}-{time.timestamp():.6f}",
                "source": f"/lumpwatch/{self.site}/{self.camera}",
                "type": f"io.lumpwatch.silence.{change}.v1",
                "subject": self.camera,
                "time": time.isoformat().replace("+00:00", "Z"),
                "datacontenttype": "application/json",
                "data": {
                    "site": self.site,
                    "camera": self.camera,
                    "silent": self.silent,
                    "for_s": round(self.for_s, 3),
                    "reason": self.reason or None,
                },
            }
        ).encode()

    def __str__(self) -> str:
        """For a person."""
        if not self.silent:
            return f"{self.camera}: heard again after {self.for_s:.1f} s"
        why = {
            "never_heard": f"no heartbeat within {self.for_s:.1f} s: is the daemon running with this camera",
            "not_heard": f"no heartbeat for {self.for_s:.1f} s: the daemon has stopped, or cannot be reached",
            "not_valid": f"the daemon lives but has not decided for {self.for_s:.1f} s",
        }[self.reason]
        return f"{self.camera}: SILENT, {why}; nothing is known of this feed"


class SilenceWatch:
    """Follows the heartbeats of some cameras; safe to be told in one thread and asked in another."""

    def __init__(self, site: str, regions: Mapping[str, Collection[str]], now_s: float) -> None:
        """`regions` are those of each camera; `now_s` is the monotonic time at which following begins."""
        self._site = site
        self._regions = {camera: frozenset(rois) for camera, rois in regions.items()}
        self._lock = threading.Lock()
        self._until_s = dict.fromkeys(self._regions, now_s + VALID_S)
        self._valid_s = dict.fromkeys(self._until_s, now_s)
        self._heard: set[str] = set()
        self._invalid: set[str] = set()
        self._silent: set[str] = set()

    @property
    def silent(self) -> frozenset[str]:
        """The cameras that are silent, as `changes` last said."""
        with self._lock:
            return frozenset(self._silent)

    def heard(self, payload: bytes, now_s: float) -> None:
        """A heartbeat came; one that cannot be understood, or is of another camera, counts for nothing."""
        try:
            beat = Heartbeat.model_validate_json(payload)
        except ValidationError:
            return
        with self._lock:
            if beat.camera not in self._until_s:
                return
            self._heard.add(beat.camera)
            if not beat.valid or not self._regions[beat.camera] <= beat.rois.keys():
                self._invalid.add(beat.camera)
                return
            self._invalid.discard(beat.camera)
            self._until_s[beat.camera] = now_s + beat.valid_s
            if beat.camera not in self._silent:
                self._valid_s[beat.camera] = now_s

    def changes(self, now_s: float) -> list[Silence]:
        """The cameras that fell silent or are heard again since the last call."""
        with self._lock:
            return [change for camera in self._until_s if (change := self._change(camera, now_s)) is not None]

    def _change(self, camera: str, now_s: float) -> Silence | None:
        for_s = now_s - self._valid_s[camera]
        invalid = camera in self._invalid
        silent = invalid or now_s > self._until_s[camera]
        if silent == (camera in self._silent):
            return None
        if not silent:
            self._silent.discard(camera)
            self._valid_s[camera] = now_s
            return Silence(self._site, camera, silent=False, for_s=for_s, reason="")
        self._silent.add(camera)
        reason = "not_valid" if invalid else "not_heard" if camera in self._heard else "never_heard"
        return Silence(self._site, camera, silent=True, for_s=for_s, reason=reason)
