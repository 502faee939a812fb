"""Evidence for browsers: fetched over the bus, made playable on demand, kept in a bounded folder.

The stored clip is FFV1, which no browser plays. It becomes H.264 with the times of its frames, in the colours that
it has. Nothing else is changed; the original can be had by `lumpwatch evidence fetch`.
"""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.bus import Bus, Keys
from lumpwatch.service.core import Frame
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import EvidenceError, fetch_evidence, read_frames
from lumpwatch.service.protocol import CLIP, META, STATES, STILL, TIMES

_PLAYABLE, _CURVE = "clip.mp4", "curve.json"
_SIDE = 1920


class Clips:
    """Evidence that was asked for; `folder` holds nothing else."""

    def __init__(self, bus: Bus, site: str, folder: Path, most_bytes: int) -> None:
        self._bus = bus
        self._keys = Keys(site)
        self._folder = folder
        self._most = most_bytes
        self._lock = threading.Lock()  # one conversion at a time: it must not take the cores from the filter

    def listing(self, camera: str, roi: str, newest: int = 100) -> list[dict[str, Any]]:
        """What evidence a region has, oldest first. Raises EvidenceError."""
        return json.loads(self._ask(camera, roi, {"newest": str(newest)}))

    def meta(self, camera: str, roi: str, evidence: str) -> dict[str, Any]:
        """What one piece is, with its verdict. Raises EvidenceError."""
        return json.loads(self._ask(camera, roi, {"id": evidence}))

    def file(self, camera: str, roi: str, evidence: str, name: str) -> Path:
        """A file of a piece: `still.jpg`, `clip.mp4` or `curve.json`. Raises LumpwatchError."""
        if name not in (STILL, _PLAYABLE, _CURVE):
            raise EvidenceError(f"'{name[:60]}' is none of {STILL}, {_PLAYABLE}, {_CURVE}")
        with self._lock:
            folder = self._fetched(camera, roi, evidence)
            if name == _PLAYABLE and not (folder / name).exists():
                _convert(folder)
            if name == _CURVE and not (folder / name).exists():
                (folder / name).write_text(json.dumps(_curve(folder)))
            if not (folder / name).exists():
                raise EvidenceError(f"{camera}/{roi}/{evidence}: has no {name}")
            (folder / META).touch()
            self._prune(folder)
            return folder / name

    def _fetched(self, camera: str, roi: str, evidence: str) -> Path:
        key = self._keys.command(camera, roi, "evidence")
        if not evidence.replace("-", "").isdigit():
            raise EvidenceError(f"'{evidence[:60]}' is not the id of evidence")
        folder = self._folder / f"{camera}.{roi}.{evidence}"
        if not (folder / META).exists():
            self._folder.mkdir(parents=True, exist_ok=True)
            fetched = fetch_evidence(self._bus, key, evidence, self._folder)
            if fetched.folder != folder:
                shutil.rmtree(fetched.folder, ignore_errors=True)
                raise EvidenceError(f"{key}: the answer is another piece of evidence")
        return folder

    def _ask(self, camera: str, roi: str, parameters: dict[str, str]) -> bytes:
        key = self._keys.command(camera, roi, "evidence")
        replies = self._bus.ask(key, parameters, timeout_s=5.0)
        if not replies:
            raise EvidenceError(f"nobody answers for {camera}/{roi}")
        if replies[0].payload is None:
            raise EvidenceError(f"{camera}/{roi}: {replies[0].error}")
        return replies[0].payload

    def _prune(self, keep: Path) -> None:
        """Remove what was looked at longest ago, until the rest fits."""
        pieces = [(meta.stat().st_mtime, meta.parent) for meta in self._folder.glob(f"*/{META}")]
        sizes = {folder: sum(file.stat().st_size for file in folder.iterdir()) for _, folder in pieces}
        total = sum(sizes.values())
        for _, folder in sorted(pieces):
            if total <= self._most:
                break
            if folder != keep:
                total -= sizes[folder]
                shutil.rmtree(folder, ignore_errors=True)


def _convert(folder: Path) -> None:
    """Make `clip.mp4` of `clip.mkv`. Raises LumpwatchError."""
    import av

    temporary = folder / f".{_PLAYABLE}"
    try:
        with av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream: Any = None
            first_s, last = 0.0, -1
            for frame in _frames(folder):
                picture, pixels = _picture(frame)
                if stream is None:
                    stream = container.add_stream(
                        "libx264", rate=25, options={"preset": "veryfast", "crf": "23"}
                    )
                    stream.width, stream.height = picture.shape[1], picture.shape[0]
                    stream.pix_fmt = "yuv420p"
                    stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
                    stream.codec_context.thread_count = 1
                    first_s = frame.capture_s
                coded = av.VideoFrame.from_ndarray(picture, format=pixels)
                last = max(last + 1, round(1000 * (frame.capture_s - first_s)))
                coded.pts, coded.time_base = last, Fraction(1, 1000)
                container.mux(stream.encode(coded))
            if stream is None:
                raise EvidenceError(f"{folder.name}: the clip holds no frame")
            container.mux(stream.encode(None))
        temporary.rename(folder / _PLAYABLE)
    except (OSError, ValueError, av.error.FFmpegError) as error:
        raise LumpwatchError(f"{folder.name}: the clip cannot be made playable ({error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def _frames(folder: Path) -> Iterator[Frame]:
    for frame, _, _ in read_frames(folder / CLIP, folder / TIMES):
        yield frame


def _picture(frame: Frame) -> tuple[NDArray[np.uint8], str]:
    """The pixels as FFmpeg takes them, with even sides."""
    if frame.encoding == "i420":
        import cv2

        picture, pixels = np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_YUV2BGR_I420), np.uint8), "bgr24"
    else:
        picture, pixels = frame.data, "bgr24" if frame.encoding == "bgr8" else "gray"
    height, width = (picture.shape[0] // 2) * 2, (picture.shape[1] // 2) * 2
    return np.ascontiguousarray(picture[:height, :width]), pixels


def _curve(folder: Path) -> dict[str, Any]:
    """Where the clip lies in the picture, and what was decided, by seconds from its beginning."""
    times = [json.loads(line) for line in (folder / TIMES).read_bytes().splitlines()]
    states = [json.loads(line) for line in (folder / STATES).read_bytes().splitlines()]
    if not times:
        raise EvidenceError(f"{folder.name}: the clip holds no frame")
    first = times[0]
    captured = {int(one["seq"]): float(one["capture_s"]) - float(first["capture_s"]) for one in times}
    height, width = first["shape"][:2]
    return {
        "size": first["size"],
        "crop": first["crop"] or [0, 0, *first["size"]],
        "clip": [width, height * 2 // 3 if first["encoding"] == "i420" else height],
        "frames": [
            {
                "time_s": round(captured[state["frame"]], 4),
                "state": state["state"],
                "existence": state["existence"],
                "objects": state.get("objects", []),
            }
            for state in states
            if state["frame"] in captured
        ],
    }
