"""One piece of evidence as a folder.

meta.json       what it is, and size and checksum of every other file
clip.mkv        the frames as the filter saw them, without loss
frames.jsonl    their exact times, and where in the picture they lie
states.jsonl    what was decided, one line a frame: the existence curve
state.npz       the state of the filter before the first frame
roi.prior       the prior in use; left out where there was none
camera.json     the camera's configuration, for this ROI; without the address of the source
still.jpg       the frame that raised the alarm
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import AliasChoices, Field

from lumpwatch.service.core import AlarmClass
from lumpwatch.service.protocol.messages import Record
from lumpwatch.service.protocol.requests import Name, Request

Ended = Literal["post_roll", "memory", "changed", "stopped"]
"""Why a clip ends: as configured, memory was short, the prior or the picture changed, the monitor stopped."""
META, CLIP, TIMES, STATES = "meta.json", "clip.mkv", "frames.jsonl", "states.jsonl"
STATE, PRIOR, CAMERA, STILL = "state.npz", "roi.prior", "camera.json", "still.jpg"


class StoredFile(Record):
    """One file of a piece of evidence."""

    size: int
    """Bytes."""
    sha256: str
    """Checksum, hexadecimal."""


class EvidenceMeta(Record):
    """What a piece of evidence is."""

    version: Literal[1] = 1
    """Of this format."""
    id: str
    """That of the alarm record that was raised."""
    site: str
    """Site id."""
    camera: str
    """Camera id."""
    roi: str
    """ROI id."""
    alarm_class: AlarmClass = Field(
        validation_alias=AliasChoices("class", "alarm_class"), serialization_alias="class"
    )
    """Class of the alarm."""
    sequence: int
    """Sequence of the alarm record."""
    time: datetime
    """When the alarm was raised, wall clock (UTC)."""
    frames: int
    """Number of frames in the clip."""
    decisive: int
    """Which of them raised the alarm, from 1; for a blind alarm, the last one before it."""
    pre_roll_s: float
    """Seconds of the clip before that frame."""
    post_roll_s: float
    """Seconds of the clip after it."""
    ended: Ended
    """Why the clip ends: `post_roll` as configured, `memory` was short, the prior or the picture `changed`, the
    monitor `stopped`."""
    existence: float
    """Probability that a lump is there, on that frame."""
    prior: int
    """Version of the prior in use; 0: the stated defaults."""
    exact: bool
    """Whether a replay gives the same decisions; false for trackers, whose background is not kept."""
    software: str
    """Version of lumpwatch."""
    files: dict[str, StoredFile]
    """The files beside this one."""

    @property
    def size(self) -> int:
        """Bytes of all files but this one."""
        return sum(file.size for file in self.files.values())

    @property
    def name(self) -> str:
        """In one word for people and commands."""
        return f"{self.camera}/{self.roi}/{self.id}"


_Whole = Annotated[int, Field(ge=0, lt=10**15)]


class EvidenceRequest(Request):
    """Ask for evidence: the newest pieces, one by its id, or bytes of one of its files."""

    newest: _Whole = 100
    """How many to list, at most 1000; the newest come last."""
    id: Name | None = None
    """Only this one."""
    file: Name | None = None
    """Bytes of this file of it."""
    offset: _Whole = 0
    """From this byte on."""
    length: _Whole | None = None
    """At most so many bytes, and at most 1 MiB."""
