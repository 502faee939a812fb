"""The clips and labels of the experiments, made or cut into a folder."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from docs.experiments.square import scene as square
from docs.experiments.traffic import scene as traffic
from lumpwatch.models.roi import Image
from lumpwatch.service.core import VideoWriter

PETS = "pets2009-s2l1-view001"
PETS_FPS, PETS_LEARNED, PETS_FRAMES = 7.0, 397, 795
_LOSSLESS = 0


def square_data(out: Path) -> None:
    """Two clips to train on, two to test on, and an empty one."""
    for name, seed in (("train0", 1000), ("train1", 1001), ("test0", 0), ("test1", 1), ("empty", 50)):
        made = square.make_scene(seed, shown=0 if name == "empty" else square.SHOWN)
        write(out / f"{name}.mkv", made.pictures, square.FPS)
        (out / f"{name}.txt").write_text(made.labels, encoding="utf-8")


def traffic_data(out: Path, seed: int = 0) -> None:
    """One clip; what shows less than half of itself is labelled with conf 0, to be ignored."""
    made = traffic.make_sequence(seed, traffic.LEARNING)
    write(out / "clip.mkv", tuple(made.pictures()), traffic.RATE, crf=8)
    rows = [
        f"{frame + 1},{vehicle.id},{box[0] - box[2] / 2:.2f},{box[1] - box[3] / 2:.2f},{box[2]:.2f},{box[3]:.2f},"
        f"{int(share >= 0.5)},1,{share:.2f}\n"
        for frame in range(traffic.FRAMES)
        for vehicle, box, share in made.truth(frame)
    ]
    (out / "clip.txt").write_text("".join(rows), encoding="utf-8")


def pets_data(footage: Path, out: Path) -> None:
    """PETS 2009 S2.L1, view 1, in two halves of their own, at its true rate. Raises OSError where it is missing."""
    labels = (footage / PETS / "gt.txt").read_text(encoding="utf-8").split()
    capture = cv2.VideoCapture(str(footage / PETS / "vtest.avi"))
    halves = {"first": range(PETS_LEARNED), "second": range(PETS_LEARNED, PETS_FRAMES)}
    try:
        for name, frames in halves.items():
            write(out / f"{name}.mkv", tuple(_read(capture) for _ in frames), PETS_FPS)
            rows = [row.split(",", 1) for row in labels]
            kept = [f"{int(f) - frames.start},{rest}\n" for f, rest in rows if int(f) - 1 in frames]
            (out / f"{name}.txt").write_text("".join(kept), encoding="utf-8")
    finally:
        capture.release()


def _read(capture: cv2.VideoCapture) -> Image:
    good, picture = capture.read()
    if not good:
        raise OSError(f"{PETS}/vtest.avi: ends too early")
    return np.asarray(picture, dtype=np.uint8)


def write(path: Path, pictures: tuple[Image, ...], fps: float, crf: int = _LOSSLESS) -> None:
    """A video of the pictures."""
    height, width = pictures[0].shape[:2]
    with VideoWriter(path, width, height, fps, crf=crf) as video:
        for picture in pictures:
            video.write(picture)
