"""A simulated feed as files: the video, its labels, the truth about it, and a configuration that watches it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from lumpwatch.service.core import VideoWriter
from lumpwatch.service.simulator.feed import FeedSimulator, Truth
from lumpwatch.service.simulator.spec import FeedSpec

_CRF = 20
_MOUTH = """\
      - id: mouth
        watch: mouth
        polygon: {polygon}
        mouth: {{belt: apron}}
"""


@dataclass(frozen=True, slots=True)
class WrittenFeed:
    """The files of `write_video`."""

    video: Path
    labels: Path
    spec: Path
    site: Path
    site_kept: bool = False
    """Whether another `site.yaml` was there, which was left as it is."""


def write_video(
    spec: FeedSpec, seconds: float, out_dir: Path, progress: Callable[[int, int], None] | None = None
) -> WrittenFeed:
    """Render the feed into `video.mp4`, `gt.txt`, `spec.json` and `site.yaml` in `out_dir`, made when missing.

    `gt.txt` is MOTChallenge text without a header, `frame,id,x,y,w,h,conf,class,visibility,model`:
    frame from 1, box in pixels of the whole picture (0 is the left and upper border), conf and
    class 1, visibility 0..1, and in the tenth column the model that moves the lump, `belt` or `fall`.
    A `site.yaml` that is there already stays as it is: it may be somebody's own.
    The video is H.264 of the quality `spec.h264_crf` (20 where it is none), coded once.
    `progress` gets the number of frames done and to do. Raises ValueError where `seconds` holds no
    frame, OSError where a file cannot be written.
    """
    frames = round(seconds * spec.fps)
    if frames < 1:
        raise ValueError(f"{seconds:g} s hold no frame at {spec.fps:g} frames a second")
    out_dir.mkdir(parents=True, exist_ok=True)
    paths = WrittenFeed(
        video=out_dir / "video.mp4",
        labels=out_dir / "gt.txt",
        spec=out_dir / "spec.json",
        site=out_dir / "site.yaml",
    )
    crf = _CRF if spec.h264_crf is None else spec.h264_crf
    simulator = FeedSimulator(spec.model_copy(update={"h264_crf": None}))
    lumps: dict[int, dict[str, object]] = {}
    with (
        VideoWriter(paths.video, spec.width, spec.height, spec.fps, crf=crf) as video,
        paths.labels.open("w", encoding="ascii") as labels,
    ):
        for frame in range(1, frames + 1):
            picture, truths = simulator.render()
            video.write(picture)
            for truth in sorted(truths, key=lambda truth: truth.id):
                labels.write(_line(frame, truth))
                lump = lumps.setdefault(truth.id, {"size_mm": round(truth.size_mm, 1), "first_frame": frame})
                lump["last_frame"] = frame
                if not truth.on_belt:
                    lump.setdefault("falls_frame", frame)
            if progress is not None:
                progress(frame, frames)
    about: dict[str, object] = {
        "spec": spec.model_dump(mode="json"),
        "frames": frames,
        "polygon": simulator.polygon,
        "lip_row": simulator.geometry.lip_row,
        "rim_row": simulator.geometry.rim_row,
        "homography": simulator.homography.tolist(),
        "lumps": {str(key): value for key, value in sorted(lumps.items())},
    }
    if spec.has_mouth:
        about["mouth"] = _mouth(simulator)
    paths.spec.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    configuration = _configuration(simulator)
    try:
        with paths.site.open("x", encoding="utf-8") as site:
            site.write(configuration)
    except FileExistsError:
        return replace(paths, site_kept=paths.site.read_bytes() != configuration.encode())
    return paths


def _mouth(feed: FeedSimulator) -> dict[str, object]:
    """What the crusher's mouth did; seconds from the start."""
    return {
        "polygon": feed.mouth_polygon,
        "bridges": [[round(one.from_s, 2), round(one.until_s, 2)] for one in feed.bridges],
        "lodged": [[number, round(at, 2), round(until, 2)] for number, at, until in feed.lodged],
    }


def _configuration(feed: FeedSimulator) -> str:
    """One camera as a user would write it: a calibrated region, and one of the mouth where that is worth watching."""
    spec = feed.spec
    width, length = spec.belt_width_mm, spec.belt_length_mm
    points_mm = [[0.0, 0.0], [width, 0.0], [width, length], [0.0, length]]
    corners = []
    for x, y in points_mm:
        u, v, _ = feed.geometry.project(x - width / 2, y)
        corners.append([round(u / spec.width, 4), round(v / spec.height, 4)])
    outline = feed.belt_polygon if spec.has_mouth else feed.polygon
    polygon = [[round(v, 4) for v in point] for point in outline]
    mouth = [[round(v, 4) for v in point] for point in feed.mouth_polygon]
    watched = _MOUTH.format(polygon=mouth) if spec.has_mouth else ""
    return f"""\
site: simulated
store: {{path: var}}
cameras:
  - id: cam
    source: {{url: video.mp4}}
    rois:
      - id: apron
        polygon: {polygon}
        calibration:
          points: {corners}
          points_mm: {points_mm}
          lip: {[corners[3], corners[2]]}
          limit_mm: {spec.limit_mm:g}
{watched}"""


def _line(frame: int, truth: Truth) -> str:
    box = f"{truth.x:.2f},{truth.y:.2f},{truth.w:.2f},{truth.h:.2f}"
    return f"{frame},{truth.id},{box},1,1,{truth.visibility:.3f},{truth.model}\n"
