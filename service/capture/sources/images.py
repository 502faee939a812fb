"""A folder of images as a source of frames, in natural order: 2.png comes before 10.png."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import av
from av import FFmpegError, VideoFrame

from lumpwatch.service.capture.sources.assemble import Assembler
from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.decoding import refusing
from lumpwatch.service.capture.sources.files import check_regular, os_error
from lumpwatch.service.capture.sources.pacing import Pacer
from lumpwatch.service.capture.sources.pixels import SourceEncoding
from lumpwatch.service.capture.sources.turning import Matrix, exif_matrix
from lumpwatch.service.config import PICTURE_SUFFIXES, SourceConfig
from lumpwatch.service.core import Frame

DEFAULT_FPS = 10.0
_DIGITS = re.compile(r"(\d+)")


def natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """A key that sorts numbers in file names by value."""
    parts = _DIGITS.split(path.name.lower())
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts], path.name


class ImageSource:
    """Plays the pictures of a folder at `fps`, or as fast as they are read; see `Source`.

    A file that is no readable picture (`corrupt`) ends the run with a SourceError that names it. Pictures of another
    size than the one before are counted (`size_changed`).
    """

    def __init__(
        self,
        config: SourceConfig,
        camera_id: str,
        encoding: SourceEncoding,
        *,
        count: Callable[[str], None],
        pacer: Pacer,
    ) -> None:
        self._count = count
        self._config = config
        self._name = f"camera {camera_id}: {config.path}"
        self._fps = config.fps or DEFAULT_FPS
        self._pacer = pacer
        self._assembler = Assembler(encoding)
        self._paths: list[Path] = []
        self._played = 0

    @property
    def nominal_fps(self) -> float:
        """As configured, or 10."""
        return self._fps

    @property
    def length(self) -> int | None:
        """Number of pictures from `start_s` on; None for a loop, and while it is not open."""
        return len(self._paths) if self._paths and not self._config.loop else None

    def open(self) -> None:
        """List the folder; raises SourceError."""
        self.close()
        try:
            found = [p for p in self._config.path.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES]
        except OSError as error:
            raise os_error(self._name, error) from error
        skipped = round(self._config.start_s * self._fps)
        if len(found) <= skipped:
            raise SourceError(
                Fault.EMPTY, f"{self._name}: {len(found)} pictures, none from {self._config.start_s:g} s on"
            )
        self._paths = sorted(found, key=natural)[skipped:]
        self._pacer.restart()

    def close(self) -> None:
        """Forget the list; idempotent."""
        self._paths = []
        self._played = 0

    def read(self) -> Frame | None:
        """The next picture, when it is due; None after the last one; raises SourceError."""
        if not self._paths:
            raise RuntimeError("read of a source that is not open")
        if self._played >= len(self._paths) and not self._config.loop:
            return None
        path = self._paths[self._played % len(self._paths)]
        name = f"{self._name}/{path.name}"
        picture, matrix = _load(path, name)
        if self._assembler.is_new_size(picture, name, matrix):
            self._count(Fault.SIZE_CHANGED)
        times = self._pacer.wait(self._played / self._fps)
        self._played += 1
        return self._assembler.make(picture, times)


def _load(path: Path, name: str) -> tuple[VideoFrame, Matrix | None]:
    """The picture, and how its EXIF asks to turn it. Raises SourceError."""
    try:
        check_regular(path, name)
        content = path.read_bytes()
        # From memory: FFmpeg would read a percent sign in the path as a pattern.
        with av.open(io.BytesIO(content), mode="r") as container:
            context = container.streams.video[0].codec_context
            context.options = refusing(context.name)
            for picture in container.decode(video=0):
                if not picture.is_corrupt:
                    return picture, exif_matrix(content)
    except FFmpegError:
        pass  # FFmpeg's errors are OSErrors in part, so they come first
    except OSError as error:
        raise os_error(name, error) from error
    except IndexError:
        pass  # no video stream in it
    raise SourceError(Fault.CORRUPT, f"{name}: not a readable picture")
