"""One feed watched by several methods: it is rendered once, and what each method says is kept on disk.

A task is a feed. Its results lie in a folder whose name is a digest of all that they depend on (the code
of filters, feed and methods), one file a method, so a run that was interrupted goes on where it stopped,
and a method that is added is watched on what the others have seen.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np

from lumpwatch.service.core.frame import Frame
from lumpwatch.service.offline.backtest.record import Recording
from lumpwatch.service.simulator.feed import FeedSimulator, Truth
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.storage.label_file import Box
from lumpwatch.service.storage.prior_file import Prior, decode_prior, encode_prior
from lumpwatch.service.training.learner import train
from tests.reproduction import matrix
from tests.reproduction.difficulty.peers import OURS, PEERS, Peer
from tests.reproduction.difficulty.simple import Said

SECONDS = 60.0
ROOT = Path(__file__).parents[3] / "build" / "reproduction" / "difficulty"
WARM_UP = 30
"""Frames that are not timed: code is compiled and memory taken."""
_NO_MATTER = ("bus", "cli", "console", "telemetry", "sources", "backtest")
"""Parts of the service that no frame goes through here."""
_TRUTH_COLUMNS = 8
"""Frame, id, x, y, w, h, whether it falls, longest diameter."""


@dataclass(frozen=True, slots=True)
class Task:
    """A feed, and who watches it."""

    scene: str
    spec: FeedSpec
    seconds: float
    peers: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of the files."""
        kind = "lumps" if self.spec.lumps_per_minute > 0 else "empty"
        spec = hashlib.sha256(self.spec.model_dump_json().encode()).hexdigest()[:6]
        return f"{self.scene}-{kind}-{self.spec.seed}-{self.seconds:g}s-{spec}"


@dataclass(frozen=True, slots=True)
class Watched:
    """What one method said of one feed."""

    recording: Recording
    sizes: np.ndarray
    """Stated longest diameter and the ends of its interval of each estimate, mm (m, 3); NaN where none."""
    frame_s: np.ndarray
    """CPU seconds of each frame (n,)."""
    run: int
    """The same for methods that watched the feed side by side: only their times compare."""


def digest() -> str:
    """Of everything that a result depends on."""
    root = Path(__file__).parents[3]
    packages = [path for package in ("models", "service") for path in (root / package).rglob("*")]
    sources = [path for path in packages if path.suffix in (".py", ".npz")]
    names = [path.relative_to(root) for path in sources]
    names = [name for name in names if name.parts[1] not in _NO_MATTER]
    names += [
        Path(__file__).with_name(name).relative_to(root) for name in ("peers.py", "simple.py", "work.py")
    ]
    total = hashlib.sha256()
    for name in sorted(names):
        total.update(str(name).encode() + (root / name).read_bytes())
    return total.hexdigest()[:12]


def learn(folder: Path, style: str, keys: Sequence[str] = tuple(PEERS), seconds: float = SECONDS) -> None:
    """Train every method on the first training feed of the style's standard scene."""
    owners = {PEERS[key].trained_as for key in keys}
    to_do = sorted(key for key in owners if not prior_path(folder, style, key).exists())
    if not to_do:
        return
    scene = matrix.scene("standard" if style == "a" else "b-standard")
    seen = list(feed(next(scene.train()), seconds))
    frames = [frame for frame, _ in seen]
    boxes = sorted(
        (_box(frame.seq + 1, truth) for frame, truths in seen for truth in truths),
        key=lambda box: (box.track, box.frame),
    )
    for key in to_do:
        _keep(prior_path(folder, style, key), _prior(PEERS[key], style, frames, boxes))


def _prior(peer: Peer, style: str, frames: list[Frame], boxes: list[Box]) -> bytes:
    camera = peer.camera(style)
    roi = camera.rois[0]
    if peer.key != OURS:
        # Its motion models have other names: training infers which led to each label.
        boxes = [replace(box, model=None) for box in boxes]
    trained = train(roi, iter(frames), tuple(boxes), Path("feed.txt"), "feed")
    return encode_prior(trained.as_prior(camera.id, roi, "feed", datetime(2026, 1, 1, tzinfo=UTC)))


def prior_path(folder: Path, style: str, key: str) -> Path:
    """Where the prior that a method takes lies."""
    return folder / f"prior-{style}-{PEERS[key].trained_as}.bin"


def prior_of(folder: Path, style: str, key: str) -> Prior:
    """The prior that a method takes, with a version as a store would give it."""
    return decode_prior(prior_path(folder, style, key).read_bytes(), key).with_version(1)


def feed(spec: FeedSpec, seconds: float) -> Iterator[tuple[Frame, tuple[Truth, ...]]]:
    """The frames of a feed with times from its start, and their lumps."""
    simulator = FeedSimulator(spec)
    for i in range(round(seconds * spec.fps)):
        picture, truths = simulator.render()
        t = i / spec.fps
        yield Frame(i, t, t, t, spec.width, spec.height, "gray8", picture), truths


def missing(folder: Path, task: Task) -> tuple[str, ...]:
    """The methods that have not watched the task's feed."""
    return tuple(key for key in task.peers if not _path(folder, task, key).exists())


def watch(folder: Path, task: Task) -> float:
    """Render the feed once and let all methods watch it that have not; keeps what they say.

    Returns the CPU time that it took, seconds.
    """
    started, run = time.process_time(), time.time_ns()
    cv2.setNumThreads(1)
    numba.set_num_threads(1)
    keys = missing(folder, task)
    if not keys:
        return 0.0
    style = task.spec.style
    watchers = {key: PEERS[key].watcher(style, prior_of(folder, style, key)) for key in keys}
    said = {key: _Said() for key in keys}
    truths: list[tuple[float, ...]] = []
    for frame, lumps in feed(task.spec, task.seconds):
        truths += [(frame.seq + 1, t.id, t.x, t.y, t.w, t.h, t.model == "fall", t.size_mm) for t in lumps]
        for key, watcher in watchers.items():
            began = time.process_time()
            now = watcher.step(frame)
            said[key].add(now, time.process_time() - began)
    _save(_path(folder, task, "truth"), truth=np.array(truths, dtype=float).reshape(-1, _TRUTH_COLUMNS))
    for key, one in said.items():
        _save(_path(folder, task, key), run=np.array(run), **one.arrays())
    return time.process_time() - started


class _Said:
    """Gathers what a method says."""

    def __init__(self) -> None:
        self._frames: list[tuple[float, float]] = []
        self._owner: list[int] = []
        self._estimates: list[np.ndarray] = []

    def add(self, said: Said, seconds: float) -> None:
        sizes = said.sizes if len(said.sizes) else np.full((len(said.boxes), 3), np.nan)
        self._owner += [len(self._frames)] * len(said.boxes)
        self._estimates.append(np.hstack([said.boxes, sizes]))
        self._frames.append((said.alarming, seconds))

    def arrays(self) -> dict[str, np.ndarray]:
        return {
            "frames": np.array(self._frames).reshape(-1, 2),
            "owner": np.array(self._owner, dtype=np.intp),
            "estimates": np.concatenate([np.empty((0, 7)), *self._estimates]),
        }


def load(folder: Path, task: Task, key: str) -> Watched:
    """What a method said of the task's feed."""
    with np.load(_path(folder, task, key)) as kept:
        frames, owner, estimates = kept["frames"], kept["owner"], kept["estimates"]
        run = int(kept["run"])
    n, spec = len(frames), task.spec
    recording = Recording(
        np.arange(1, n + 1),
        np.arange(n) / spec.fps,
        frames[:, 0],
        owner,
        estimates[:, :4],
        spec.width,
        spec.height,
        n,
        1,
    )
    return Watched(recording, estimates[:, 4:], frames[:, 1], run)


def truth_boxes(folder: Path, task: Task) -> tuple[list[Box], dict[int, float]]:
    """The labels of the task's feed, by track and frame, and the longest diameter of each lump, mm."""
    with np.load(_path(folder, task, "truth")) as kept:
        rows = kept["truth"]
    rows = rows[np.lexsort((rows[:, 0], rows[:, 1]))]
    boxes = [
        Box(
            int(r[0]),
            int(r[1]),
            float(r[2]),
            float(r[3]),
            float(r[4]),
            float(r[5]),
            "fall" if r[6] else "belt",
        )
        for r in rows
    ]
    return boxes, {int(r[1]): float(r[7]) for r in rows}


def _box(frame: int, t: Truth) -> Box:
    return Box(frame, t.id, t.x, t.y, t.w, t.h, t.model)


def _path(folder: Path, task: Task, what: str) -> Path:
    return folder / f"{task.name}.{what}.npz"


def _save(path: Path, **arrays: Any) -> None:
    part = path.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as file:
        np.savez_compressed(file, **arrays)
    part.replace(path)  # whole or not at all


def _keep(path: Path, content: bytes) -> None:
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(content)
    part.replace(path)
