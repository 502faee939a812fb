"""Several clips as one training: labelled ones, and ones in which no lump comes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path

from lumpwatch.models.learning import Track
from lumpwatch.models.learning.clips import at_interval
from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.offline import boxes_of, short_names
from lumpwatch.service.storage import Box, check_frames, ignored_frames, read_labels
from lumpwatch.service.training.footage import (
    MOST_VIEWS,
    Flow,
    Footage,
    TrainingError,
    needs_flow,
    read_footage,
)
from lumpwatch.service.training.learner import labelled_tracks
from lumpwatch.service.training.sources import sources_text

Progress = Callable[[str, int | None], AbstractContextManager[Callable[[int], None]]]
"""Told the name of a clip and its number of frames; gives what to call with the number read so far."""


@dataclass(frozen=True, slots=True)
class Clip:
    """A video and what is known of it."""

    name: str
    """For people."""
    video: Path
    labels: Path | None
    """None: no lump comes."""
    boxes: tuple[Box, ...] = ()
    left_out: frozenset[int] = frozenset()
    """Frames in which something is labelled that is to be ignored."""


@dataclass(frozen=True, slots=True)
class Lump:
    """One labelled object and its tracks: one, or one a run where the frame rate had to be changed."""

    clip: int
    id: int
    tracks: tuple[Track, ...]
    cut_off: bool
    """Whether the clip ends before it is gone."""


@dataclass(frozen=True, slots=True)
class Material:
    """What a training learns from."""

    clips: tuple[Clip, ...]
    footage: Footage
    lumps: tuple[Lump, ...]
    outside: tuple[tuple[int, int], ...]
    """Clip and id of labelled objects that never lie inside the ROI."""

    @property
    def source(self) -> str:
        """What a prior says of where it comes from."""
        return sources_text(clip.name for clip in self.clips)

    @property
    def tracks(self) -> list[Track]:
        """Of all lumps."""
        return [track for lump in self.lumps for track in lump.tracks]

    def without(self, lumps: Collection[Lump], most_views: int) -> Material:
        """The same without some lumps and without every picture that shows them, thinned to `most_views`."""
        away = {(lump.clip, lump.id) for lump in lumps}
        footage = self.footage
        kept = [
            k
            for k, moment in enumerate(footage.moments)
            if not any((moment.clip, track) in away for track in moment.tracks)
        ]
        rest = tuple(lump for lump in self.lumps if (lump.clip, lump.id) not in away)
        return replace(self, footage=footage.only(kept, most_views), lumps=rest)


def clips_of(pairs: Sequence[tuple[Path, Path]], lump_free: Sequence[Path]) -> tuple[Clip, ...]:
    """Videos with their labels, and videos without a lump. Raises LumpwatchError."""
    names = short_names([*(video for video, _ in pairs), *lump_free], "VIDEO")
    with_lumps = [
        Clip(name, video, labels, read_labels(labels), ignored_frames(labels))
        for name, (video, labels) in zip(names, pairs, strict=False)
    ]
    return (*with_lumps, *map(Clip, names[len(pairs) :], lump_free, [None] * len(lump_free)))


def confirmed_clips(found: Sequence[tuple[Path, Path | None]]) -> tuple[Clip, ...]:
    """Videos whose labels say all that is known: none, or an empty file, is a confirmed false alarm.

    The same file name may come twice, from what was kept and from what is new. Raises LumpwatchError.
    """
    clips = []
    for video, labels in found:
        boxes = () if labels is None else boxes_of(labels)
        left_out = frozenset() if labels is None else ignored_frames(labels)
        clips.append(Clip(video.name, video, labels if boxes else None, boxes, left_out))
    return tuple(clips)


def gather(camera: CameraConfig, roi: RoiConfig, clips: tuple[Clip, ...], progress: Progress) -> Material:
    """Read all clips. Raises LumpwatchError naming the clip that cannot be used."""
    only = camera.model_copy(update={"rois": (roi,)})
    flow = Flow() if needs_flow(roi) else None
    lump_free = sum(clip.labels is None for clip in clips)
    parts: list[Footage] = []
    for number, clip in enumerate(clips):
        # Pictures without a lump must not crowd out those with one.
        share = (
            MOST_VIEWS // 2 // lump_free if clip.labels is None else MOST_VIEWS // (len(clips) - lump_free)
        )
        unread: Counter[str] = Counter()
        frames, length = read_frames(only, clip.video, partial(_add, unread))
        with closing(frames), progress(clip.name, length) as advance:
            part = read_footage(
                roi,
                frames,
                clip.boxes,
                advance,
                clip=number,
                left_out=clip.left_out,
                most_views=max(share, 1),
                flow=flow,
            )
        if clip.labels is not None and unread["corrupt"]:
            raise TrainingError(
                f"{clip.name}: {unread['corrupt']} of its frames cannot be decoded, and labels are numbered by frames: "
                "encode it anew and label that"
            )
        if unread["size_changed"]:
            raise TrainingError(f"{clip.name}: its pictures change their size: train on clips of one size")
        if clip.labels is not None:
            check_frames(clip.boxes, part.count, clip.labels, clip.name)
        first = parts[0] if parts else part
        if (part.width, part.height) != (first.width, first.height):
            raise TrainingError(
                f"{clip.name}: its pictures are {part.width} x {part.height}, those of {clips[0].name} "
                f"{first.width} x {first.height}: train on clips of one size"
            )
        parts.append(part)
    return _joined(roi, clips, parts)


def _add(counts: Counter[str], reason: str) -> None:
    counts[reason] += 1


def _joined(roi: RoiConfig, clips: tuple[Clip, ...], parts: list[Footage]) -> Material:
    # The slowest camera decides: what it did not see cannot be made up.
    interval = max(
        part.interval_s for part, clip in zip(parts, clips, strict=True) if clip.labels is not None
    )
    footage = replace(
        parts[0],
        views=[view for part in parts for view in part.views],
        moments=[moment for part in parts for moment in part.moments],
        interval_s=interval,
        count=sum(part.count for part in parts),
        cells=parts[-1].cells,
    )
    lumps: list[Lump] = []
    outside: list[tuple[int, int]] = []
    for number, (clip, part) in enumerate(zip(clips, parts, strict=True)):
        for track_id, group in groupby(clip.boxes, key=lambda box: box.track):
            assert clip.labels is not None
            found = labelled_tracks(roi.detector.learning, part.roi, list(group), clip.labels)
            if not found:
                outside.append((number, track_id))
                continue
            tracks = [t for track in found for t in at_interval(track, part.interval_s, interval)]
            cut_off = max(box.frame for box in clip.boxes if box.track == track_id) >= part.count
            lumps.append(Lump(number, track_id, tuple(tracks), cut_off))
    if not footage.views or not any(len(view.objects) for view in footage.views):
        names = ", ".join(str(clip.labels) for clip in clips if clip.labels is not None)
        raise TrainingError(f"{names}: no labelled box lies inside roi {roi.id}")
    return Material(clips, footage, tuple(lumps), tuple(outside))
