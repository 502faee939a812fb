"""Writes the files of one piece of evidence; see `lumpwatch.service.evidence.folder` for what they are."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import utc
from lumpwatch.service.evidence.clip import sidecar, write_clip
from lumpwatch.service.evidence.recorder import Clip
from lumpwatch.service.evidence.state_file import encode_state
from lumpwatch.service.evidence.still import still
from lumpwatch.service.protocol import (
    CAMERA,
    CLIP,
    META,
    PRIOR,
    STATE,
    STATES,
    STILL,
    TIMES,
    EvidenceMeta,
    StoredFile,
    state_line,
)
from lumpwatch.service.storage import encode_prior

_BLOCK = 1 << 20


def write_files(folder: Path, clip: Clip, site: str, camera: CameraConfig, software: str) -> EvidenceMeta:
    """Write all files into an empty folder, flushed to the disk.

    Raises OSError, ValueError and av.error.FFmpegError.
    """
    trigger, roi = clip.trigger, camera.roi(clip.trigger.roi)
    decisive = clip.kept[clip.decisive]
    first_s, last_s = clip.kept[0].frame.capture_s, clip.kept[-1].frame.capture_s
    lines = [state_line(moment.result(roi.id), camera.id, first_s).line() for moment in clip.kept]
    contents = {
        TIMES: b"".join(
            sidecar(moment.frame, moment.now_s, moment.result(roi.id).quality) for moment in clip.kept
        ),
        STATES: b"".join(line + b"\n" for line in lines),
        STATE: encode_state(clip.start),
        CAMERA: _camera_text(camera, roi.id).encode(),
        STILL: still(decisive, roi, trigger),
    }
    if clip.start.prior is not None:
        contents[PRIOR] = encode_prior(clip.start.prior)
    write_clip(folder / CLIP, [moment.frame for moment in clip.kept])
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    result = decisive.result(roi.id)
    meta = EvidenceMeta(
        id=trigger.id,
        site=site,
        camera=camera.id,
        roi=roi.id,
        alarm_class=trigger.alarm_class,
        sequence=trigger.sequence,
        time=utc(trigger.wall_s),
        frames=len(clip.kept),
        decisive=clip.decisive + 1,
        pre_roll_s=round(decisive.frame.capture_s - first_s, 3),
        post_roll_s=round(last_s - decisive.frame.capture_s, 3),
        ended=clip.ended,
        existence=round(result.existence, 6),
        prior=result.prior,
        exact=clip.start.exact,
        software=software,
        files={name: _stored(folder / name) for name in sorted((CLIP, *contents))},
    )
    (folder / META).write_text(meta.model_dump_json(by_alias=True, indent=2) + "\n", encoding="utf-8")
    _flush(folder / META)
    _flush(folder)
    return meta


def _camera_text(camera: CameraConfig, roi: str) -> str:
    """What a replay needs to know; the address of the source may hold a password, so it stays out."""
    source = camera.source.model_copy(update={"url": type(camera.source.url)("evidence")})
    kept = camera.roi(roi)
    if kept.watches_mouth:  # the region of the belt is not kept: the feed then counts as running
        kept = kept.model_copy(update={"mouth": kept.mouth.model_copy(update={"belt": None})})
    alone = camera.model_copy(update={"source": source, "rois": (kept,)})
    tree = alone.model_dump_json(exclude={"source": {"url"}}, indent=2)
    return tree + "\n"


def _stored(path: Path) -> StoredFile:
    """Size and checksum of a file that is on the disk afterwards."""
    digest, size = hashlib.sha256(), 0
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
            size += len(block)
        os.fsync(file.fileno())
    return StoredFile(size=size, sha256=digest.hexdigest())


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
