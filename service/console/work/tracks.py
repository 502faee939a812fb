"""Labels as people draw them: a few boxes of each lump, with the frames between them interpolated.

A track is what one lump is in a clip. Its keys are boxes that somebody drew or accepted; between two keys the box
moves and grows evenly. In MOTChallenge text every frame has its box.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from lumpwatch.service.storage import Box, is_proposal

_TOLERANCE_PX = 1.0
HEAD = "# frame,id,x,y,w,h,conf,class,visibility; frames from 1, pixels of the whole picture\n"

Pixels = Annotated[float, Field(ge=-20_000, le=20_000, allow_inf_nan=False)]
Side = Annotated[float, Field(gt=0, le=20_000, allow_inf_nan=False)]
Frame = Annotated[int, Field(ge=1, le=10_000_000)]


class _Plain(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Key(_Plain):
    """A box in a frame, by its top left corner."""

    frame: Frame
    """From 1."""
    x: Pixels
    y: Pixels
    w: Side
    h: Side

    @property
    def place(self) -> tuple[float, float, float, float]:
        """The box."""
        return self.x, self.y, self.w, self.h


class Track(_Plain):
    """One lump."""

    id: int = Field(ge=1, le=1_000_000)
    keys: tuple[Key, ...] = Field(min_length=1, max_length=5000)
    """Ordered by frame."""
    ignored: tuple[Key, ...] = Field(default=(), max_length=5000)
    """Boxes in which it may be as well and nobody vouches for: they teach nothing."""
    existence: float | None = Field(default=None, ge=0, le=1)
    """How sure the filter was that proposed it; null: a person drew it."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        frames = [key.frame for key in self.keys]
        if frames != sorted(set(frames)):
            raise ValueError(f"track {self.id}: its boxes are not in the order of their frames")
        return self

    def boxes(self) -> list[Key]:
        """Its box in each frame from the first key to the last."""
        found = [self.keys[0]]
        for a, b in zip(self.keys, self.keys[1:], strict=False):
            found += [_between(a, b, frame) for frame in range(a.frame + 1, b.frame + 1)]
        return found


class Labels(_Plain):
    """What people have said of a clip."""

    tracks: tuple[Track, ...] = Field(default=(), max_length=500)
    proposals: tuple[Track, ...] = Field(default=(), max_length=500)
    """What the filter proposed and nobody has judged yet."""
    empty: bool = False
    """Somebody has looked, and no lump comes in this clip."""

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        for tracks in (self.tracks, self.proposals):
            if len({track.id for track in tracks}) != len(tracks):
                raise ValueError("two tracks have the same id")
        if self.empty and self.tracks:
            raise ValueError("a clip without lumps has no tracks")
        return self

    @property
    def last(self) -> int:
        """The last frame that has a box; 0 where none has."""
        return max((track.keys[-1].frame for track in (*self.tracks, *self.proposals)), default=0)


def to_mot(labels: Labels) -> str:
    """The tracks as MOTChallenge text; proposals are no labels and stay out."""
    rows = []
    for track in labels.tracks:
        boxes = track.boxes()
        vouched = {box.frame for box in boxes}
        rows += [(box.frame, track.id, box, 1) for box in boxes]
        rows += [(box.frame, track.id, box, 0) for box in track.ignored if box.frame not in vouched]
    rows.sort(key=lambda row: row[:2])
    lines = [
        f"{frame},{track},{box.x:.2f},{box.y:.2f},{box.w:.2f},{box.h:.2f},{conf},{conf or -1},-1\n"
        for frame, track, box, conf in rows
    ]
    return HEAD + "".join(lines)


def from_boxes(boxes: Sequence[Box]) -> tuple[Track, ...]:
    """Tracks of boxes that a label file holds."""
    found: dict[int, list[Key]] = {}
    for box in boxes:
        found.setdefault(box.track, []).append(Key(frame=box.frame, x=box.x, y=box.y, w=box.w, h=box.h))
    return tuple(
        Track(id=track, keys=thinned(sorted(keys, key=lambda key: key.frame)))
        for track, keys in sorted(found.items())
    )


def from_proposals(text: str) -> tuple[Track, ...]:
    """Tracks of the proposals that `lumpwatch train --suggest` wrote."""
    sure: dict[int, list[tuple[Key, float]]] = {}
    unsure: dict[int, list[Key]] = {}
    for line in text.splitlines():
        if line.startswith("#") or not line.strip():
            continue
        frame, track, x, y, w, h, conf = map(float, line.split(",")[:7])
        key = Key(frame=int(frame), x=x, y=y, w=w, h=h)
        if is_proposal(line):
            sure.setdefault(int(track), []).append((key, conf))
        else:
            unsure.setdefault(int(track), []).append(key)
    return tuple(
        Track(
            id=track,
            keys=thinned([key for key, _ in rows]),
            ignored=tuple(unsure.get(track, ())),
            existence=max(conf for _, conf in rows),
        )
        for track, rows in sorted(sure.items())
    )


def thinned(boxes: Sequence[Key], tolerance_px: float = _TOLERANCE_PX) -> tuple[Key, ...]:
    """The fewest of the boxes (about) from which all others follow within a tolerance.

    The Ramer-Douglas-Peucker scheme, over the four sides of the box and with time as the axis.
    """
    kept = {0, len(boxes) - 1}
    spans = [(0, len(boxes) - 1)]
    while spans:
        low, high = spans.pop()
        worst, at = 0.0, 0
        for i in range(low + 1, high):
            straight = _between(boxes[low], boxes[high], boxes[i].frame)
            off = max(abs(a - b) for a, b in zip(straight.place, boxes[i].place, strict=True))
            if off > worst:
                worst, at = off, i
        if worst > tolerance_px:
            kept.add(at)
            spans += [(low, at), (at, high)]
    return tuple(boxes[i] for i in sorted(kept))


def _between(a: Key, b: Key, frame: int) -> Key:
    share = (frame - a.frame) / (b.frame - a.frame)
    x, y, w, h = (p + share * (q - p) for p, q in zip(a.place, b.place, strict=True))
    return Key(frame=frame, x=x, y=y, w=w, h=h)
