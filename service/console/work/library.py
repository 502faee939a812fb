"""The clips that are labelled, in the store: recorded from a camera or uploaded, bounded together.

    <store>/console/clips/<id>/about.json      name, camera, size, who brought it
    <store>/console/clips/<id>/<name>.mkv      the video as it came
    <store>/console/clips/<id>/labels.json     tracks and proposals; grows by a revision with each change

A clip appears whole or not at all. What is labelled twice at once is refused the second time: nobody's boxes are
overwritten unseen.
"""

from __future__ import annotations

import contextlib
import re
import secrets
import shutil
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from lumpwatch.service.bus import Bus
from lumpwatch.service.console.work.errors import ClipError, LabelConflictError
from lumpwatch.service.console.work.recording import record
from lumpwatch.service.console.work.tracks import Labels, Track
from lumpwatch.service.console.work.video_frames import VideoFrames, facts_of
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import replace_file

_ID = re.compile(r"^\d{8}T\d{6}-[0-9a-f]{6}$")
_SUFFIXES = (".mp4", ".mkv", ".avi", ".mov", ".webm", ".ts", ".m4v")
_OPEN = 2


class About(BaseModel):
    """What a clip is."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    name: str
    """As it is shown; what a person called it."""
    file: str
    """Name of the video in the clip's folder."""
    camera: str
    origin: Literal["recorded", "file"]
    by: str
    made: datetime
    frames: int
    width: int
    height: int
    fps: float
    missed: int = 0
    """Pictures of the camera that did not reach the recording."""
    bytes: int = 0


class Kept(BaseModel):
    """Labels with the revision that a change must name."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    revision: int = 0
    labels: Labels = Labels()
    by: str = ""


@dataclass
class Recording:
    """One that runs, or that failed."""

    camera: str
    seconds: float
    by: str
    stop: threading.Event = field(default_factory=threading.Event)
    at_s: float = 0.0
    pictures: int = 0
    missed: int = 0
    error: str = ""
    clip: str = ""
    """Id of what came of it."""

    @property
    def runs(self) -> bool:
        """Whether it is not over."""
        return not self.error and not self.clip

    def told(self, at_s: float, pictures: int, missed: int) -> None:
        """How far it is."""
        self.at_s, self.pictures, self.missed = at_s, pictures, missed


class Library:
    """The clips below one folder."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._folder = folder
        self._most = most_bytes
        self._lock = threading.Lock()
        self._frames: OrderedDict[str, VideoFrames] = OrderedDict()
        self._reading = threading.Lock()
        self.recordings: dict[str, Recording] = {}
        """The latest of each camera."""

    def clips(self) -> list[About]:
        """All clips, newest first."""
        found = []
        for path in sorted(self._folder.glob("*/about.json"), reverse=True):
            if _ID.match(path.parent.name):
                with contextlib.suppress(OSError, ValidationError):
                    found.append(About.model_validate_json(path.read_bytes()))
        return found

    def about(self, clip: str) -> About:
        """One clip. Raises KeyError."""
        try:
            return About.model_validate_json((self._of(clip) / "about.json").read_bytes())
        except (OSError, ValidationError):
            raise KeyError(f"clip {clip[:40]}") from None

    def video(self, clip: str) -> Path:
        """Its file. Raises KeyError."""
        return self._of(clip) / self.about(clip).file

    def jpeg(self, clip: str, number: int) -> bytes:
        """A frame, from 1. Raises KeyError, VideoError."""
        about = self.about(clip)
        with self._reading:
            video = self._frames.pop(clip, None) or VideoFrames(self.video(clip), about.name)
            self._frames[clip] = video
            while len(self._frames) > _OPEN:
                self._frames.popitem(last=False)[1].close()
            return video.jpeg(number)

    def labels(self, clip: str) -> Kept:
        """What people have said. Raises KeyError, ClipError."""
        folder = self._of(clip)
        try:
            return Kept.model_validate_json((folder / "labels.json").read_bytes())
        except FileNotFoundError:
            return Kept()
        except (OSError, ValidationError) as error:
            raise ClipError(f"the labels of {self.about(clip).name} cannot be read") from error

    def label(self, clip: str, labels: Labels, revision: int, by: str) -> Kept:
        """Put labels in the place of those of a revision. Raises KeyError, ClipError, LabelConflictError."""
        about = self.about(clip)
        if labels.last > about.frames:
            raise ClipError(f"a box is in frame {labels.last}, and {about.name} has {about.frames} frames")
        with self._lock:
            before = self.labels(clip)
            if before.revision != revision:
                raise LabelConflictError(
                    f"{before.by or 'somebody'} has changed these labels meanwhile: load the page again"
                )
            kept = Kept(revision=revision + 1, labels=labels, by=by)
            self._write(self._of(clip) / "labels.json", kept.model_dump_json())
            return kept

    def propose(self, clip: str, proposals: tuple[Track, ...]) -> None:
        """Proposals in the place of those that were there; labels stay. Raises KeyError, ClipError."""
        with self._lock:
            kept = self.labels(clip)
            after = max((track.id for track in kept.labels.tracks), default=0)
            numbered = tuple(
                track.model_copy(update={"id": after + i}) for i, track in enumerate(proposals, start=1)
            )
            labels = kept.labels.model_copy(update={"proposals": numbered})
            kept = Kept(revision=kept.revision + 1, labels=labels, by="the filter")
            self._write(self._of(clip) / "labels.json", kept.model_dump_json())

    def remove(self, clip: str) -> None:
        """Remove a clip with its labels. Raises KeyError."""
        self.about(clip)
        with self._reading:
            if (video := self._frames.pop(clip, None)) is not None:
                video.close()
            shutil.rmtree(self._of(clip), ignore_errors=True)

    @property
    def room(self) -> int:
        """Bytes that are left for more clips."""
        return self._most - sum(path.stat().st_size for path in self._folder.glob("*/*") if path.is_file())

    @contextlib.contextmanager
    def arriving(self, name: str) -> Iterator[Path]:
        """A file to write a video to; it goes away unless it is taken by `take`. Raises ClipError."""
        suffix = Path(name).suffix.lower()
        if suffix not in _SUFFIXES:
            raise ClipError(f"'{name[:60]}': is none of {', '.join(_SUFFIXES)}")
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(name).stem).strip("-")[:60] or "clip"
        if self.room <= 0:
            raise ClipError("there is no room for more clips (console.work_mb): remove some")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            folder = self._folder / f".arriving-{secrets.token_hex(8)}"
            folder.mkdir()
        except OSError as error:
            raise ClipError(f"{self._folder}: cannot be written ({error.strerror})") from error
        try:
            yield folder / f"{stem}{suffix}"
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def take(
        self,
        path: Path,
        name: str,
        camera: str,
        origin: Literal["recorded", "file"],
        by: str,
        missed: int = 0,
    ) -> About:
        """Take in what has arrived. Raises VideoError, ClipError."""
        facts = facts_of(path, name)
        now = datetime.now(UTC)
        about = About(
            id=f"{now:%Y%m%dT%H%M%S}-{secrets.token_hex(3)}", name=name, file=path.name, camera=camera,
            origin=origin, by=by, made=now, frames=facts.frames, width=facts.width, height=facts.height,
            fps=round(facts.fps, 3), missed=missed, bytes=path.stat().st_size,
        )  # fmt: skip
        self._write(path.parent / "about.json", about.model_dump_json())
        path.parent.rename(self._folder / about.id)
        return about

    def record(self, bus: Bus, key: str, camera: str, seconds: float, by: str) -> Recording:
        """Begin to record. Raises ClipError where this camera is being recorded."""
        with self._lock:
            running = self.recordings.get(camera)
            if running is not None and running.runs:
                raise ClipError(f"{running.by} records this camera already")
            recording = self.recordings[camera] = Recording(camera, seconds, by)
        threading.Thread(
            target=self._record, args=(bus, key, recording), name=f"recording {camera}", daemon=True
        ).start()
        return recording

    def close(self) -> None:
        """End all recordings, which keep what they have, and close what is open."""
        for recording in self.recordings.values():
            recording.stop.set()
        with self._reading:
            while self._frames:
                self._frames.popitem()[1].close()

    def _record(self, bus: Bus, key: str, recording: Recording) -> None:
        name = f"{recording.camera}-{datetime.now(UTC):%Y%m%d-%H%M%S}.mkv"
        try:
            with self.arriving(name) as path:
                record(bus, key, path, recording.seconds, self.room, recording.stop, recording.told)
                about = self.take(path, name, recording.camera, "recorded", recording.by, recording.missed)
            recording.clip = about.id
        except LumpwatchError as error:
            recording.error = str(error)
        except Exception as error:  # a thread has nobody above it who would tell
            recording.error = f"the recording failed ({error})"
            raise

    def _of(self, clip: str) -> Path:
        if not _ID.match(clip):
            raise KeyError(f"clip {clip[:40]}")
        return self._folder / clip

    def _write(self, path: Path, text: str) -> None:
        try:
            replace_file(path, f"{text}\n".encode())
        except OSError as error:
            raise ClipError(f"{path}: cannot be written ({error.strerror})") from error
