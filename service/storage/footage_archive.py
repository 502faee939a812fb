"""The footage that a ROI was trained on, kept for the next refinement, bounded in size.

    <store>/footage/<camera>/<roi>/<name>-<digest>/<name>.mp4, gt.txt

A clip appears whole or not at all, and once: the digest is that of its labels and its length in bytes.
Beyond the bound clips are let go at random, never the one that has just come, so that what stays is of
all times.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumpwatch.service.storage.versions import StoreError

_LABELS = "gt.txt"


@dataclass(frozen=True, slots=True)
class KeptClip:
    """A clip of the archive."""

    folder: Path
    video: Path
    labels: Path

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return _size(self.folder)


@dataclass(frozen=True, slots=True)
class FootageArchive:
    """The clips of one ROI below the store."""

    root: Path
    camera: str
    roi: str
    most_bytes: int
    """0: nothing is kept."""

    @property
    def folder(self) -> Path:
        """Where the clips lie."""
        return self.root / "footage" / self.camera / self.roi

    def clips(self) -> tuple[KeptClip, ...]:
        """All clips, by name. Raises StoreError."""
        try:
            folders = sorted(path for path in self.folder.iterdir() if not path.name.startswith("."))
            found = []
            for folder in folders:
                videos = [path for path in folder.iterdir() if path.name != _LABELS]
                if len(videos) == 1 and (folder / _LABELS).is_file():
                    found.append(KeptClip(folder, videos[0], folder / _LABELS))
        except FileNotFoundError:
            return ()
        except OSError as error:
            raise StoreError(f"{error.filename}: cannot be read ({error.strerror})") from error
        return tuple(found)

    def identity(self, video: Path, labels: Path | None) -> str:
        """Name of the folder of this very clip, whether it is there or not. Raises StoreError."""
        try:
            content = b"" if labels is None else labels.read_bytes()
            digest = hashlib.sha256(content + b"%d" % _size(video)).hexdigest()[:12]
        except OSError as error:
            raise StoreError(f"{error.filename}: cannot be read ({error.strerror})") from error
        return f"{video.stem}-{digest}"

    def add(self, video: Path, labels: Path | None, rng: np.random.Generator) -> tuple[str, ...]:
        """Keep a clip (`labels` None: it shows no lump); returns the names of those let go. Raises StoreError.

        Nothing is kept of a clip that is larger than the whole archive may be.
        """
        place = self.folder / self.identity(video, labels)
        try:
            if place.is_dir() or _size(video) > self.most_bytes:
                return ()
            self.folder.mkdir(parents=True, exist_ok=True)
            self._copy(video, labels, place)
            return self._let_go(place, rng)
        except OSError as error:
            raise StoreError(f"{self.folder}: cannot be written ({error.strerror})") from error

    def _copy(self, video: Path, labels: Path | None, place: Path) -> None:
        with tempfile.TemporaryDirectory(prefix=".", dir=self.folder) as temporary:
            made = Path(temporary) / place.name
            made.mkdir()
            if video.is_dir():
                shutil.copytree(video, made / video.name)
            else:
                shutil.copyfile(video, made / video.name)
            (made / _LABELS).write_bytes(b"" if labels is None else labels.read_bytes())
            with contextlib.suppress(FileExistsError):
                made.rename(place)

    def _let_go(self, newest: Path, rng: np.random.Generator) -> tuple[str, ...]:
        clips = [clip for clip in self.clips() if clip.folder != newest]
        total = _size(newest) + sum(clip.size for clip in clips)
        gone = []
        while clips and total > self.most_bytes:
            clip = clips.pop(int(rng.integers(len(clips))))
            total -= clip.size
            gone.append(clip.video.name)
            shutil.rmtree(clip.folder)
        return tuple(gone)


def _size(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
