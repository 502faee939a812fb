"""Scenes that come from elsewhere: the simulated feed of the service, and real footage."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from tests.footage import footage_folder
from tests.reproduction.paper1.scenes import EMPTY, Scene, noisy, with_empty

FEED_FPS, FEED_MARGIN = 4.0, 12
_LABELS = {"belt": 0, "fall": 1}


def feed(seed: int, noise: float) -> Scene:
    """One large lump on the simulated belt and in its fall, with some frames before and after it.

    The first lump that is alone in the picture, at a low frame rate.
    """
    spec = FeedSpec(
        seed=seed,
        width=320,
        height=240,
        fps=FEED_FPS,
        belt_speed_mm_s=1200.0,
        lumps_per_minute=4.0,
        lump_spacing_s=8.0,
        noise=noise,
    )
    simulator = FeedSimulator(spec)
    pictures, truths = [], []
    for _ in range(3000):
        picture, seen = simulator.render()
        pictures.append(picture)
        truths.append({truth.id: truth for truth in seen})
        if len(pictures) <= FEED_MARGIN + 2:
            continue
        ended = set(truths[-FEED_MARGIN - 1]) - set(truths[-FEED_MARGIN])
        for lump in ended:
            frames = [i for i, known in enumerate(truths) if lump in known]
            first, last = frames[0] - FEED_MARGIN, frames[-1] + FEED_MARGIN
            if first >= 0 and all(set(known) <= {lump} for known in truths[first : last + 1]):
                rows = [truths[i][lump] for i in frames]
                boxes, labels = with_empty(
                    [(t.x + t.w / 2, t.y + t.h / 2) for t in rows],
                    [_LABELS[t.model] for t in rows],
                    (0.0, 0.0),
                    (FEED_MARGIN, FEED_MARGIN),
                )
                boxes[FEED_MARGIN:-FEED_MARGIN, 2:] = [(t.w, t.h) for t in rows]
                return Scene(
                    tuple(pictures[first : last + 1]), boxes, labels, 1 / FEED_FPS, simulator.polygon
                )
    raise ValueError(f"feed of seed {seed}: no lump is alone in the picture")


def football_folder() -> Path | None:
    """The football footage, or None where it is missing."""
    return footage_folder("soccer-juggling", "juggling.mp4", "gt.txt")


REAL_WIDTH, REAL_FPS, REAL_TRAINING = 320, 30.0, 125


def football(seed: int, noise: float, training: bool, empty: tuple[int, int] = EMPTY) -> Scene:
    """Real juggling: the first half of the frames for training, the second for tests.

    The ball is never out of view; the frames without it show the median picture of their half. The
    seed draws the noise that is added. Raises FileNotFoundError where the footage is missing.
    """
    folder = football_folder()
    if folder is None:
        raise FileNotFoundError("the football footage is missing")
    rng = np.random.default_rng([seed, 5])
    chosen = slice(0, REAL_TRAINING) if training else slice(REAL_TRAINING, None)
    frames = _read(folder / "juggling.mp4", REAL_WIDTH)[chosen]
    scale = REAL_WIDTH / 1280.0
    rows = np.loadtxt(folder / "gt.txt", delimiter=",")[chosen, 2:6] * scale
    boxes, labels = with_empty(
        [(r[0] + r[2] / 2, r[1] + r[3] / 2) for r in rows], [-1] * len(rows), (0.0, 0.0), empty
    )
    boxes[empty[0] : len(boxes) - empty[1], 2:] = rows[:, 2:]
    without = np.median(np.stack(frames), axis=0)
    shown = [without] * empty[0] + frames + [without] * empty[1]
    pictures = tuple(noisy(np.asarray(frame, dtype=float), noise, rng) for frame in shown)
    return Scene(pictures, boxes, labels, 1 / REAL_FPS)


def _read(path: Path, width: int) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(path))
    frames = []
    while True:
        good, frame = capture.read()
        if not good:
            break
        height = round(frame.shape[0] * width / frame.shape[1])
        frames.append(np.asarray(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)))
    capture.release()
    return frames
