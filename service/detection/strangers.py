"""Which objects of a region are not on its belt: they stand while it moves (an insect, a drop, a logo)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.picture.standing import LONGEST_LOOK_S, PlaceLook, StandingMeter
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.core import DetectedObject
from lumpwatch.service.detection.overlap import SAME_PLACE, shared

RODE_S = 2.0
"""How long an object that was seen to ride must stand to count as none of the belt's: a lump that falls over the lip
lies for a moment on what stands below. One that never rode stands at once, until it is seen to ride."""
REMEMBERED_S = 60.0
"""How long a place is remembered where something stood, for as long as nothing can be told of it anew."""

_STAYED, _RODE = 0.25, 0.5  # of the belt's way: below it has stayed, above it has ridden


@dataclass(slots=True)
class _Known:
    last_s: float
    way: deque[tuple[float, NDArray[np.float64]]] = field(default_factory=deque)
    """Times and centres."""
    rode: bool = False
    stands_since_s: float | None = None
    stands: bool = False


class Strangers:
    """Of one region; times are those of frames and rise."""

    def __init__(self, roi: Roi) -> None:
        self._roi = roi
        self._meter = StandingMeter(roi.mask)
        self._known: dict[int, _Known] = {}
        self._places: list[tuple[float, NDArray[np.float64]]] = []

    def observe(self, gray: Image, time_s: float) -> None:
        """The working picture (h, w) of a frame."""
        self._meter.add(time_s, gray)

    def among(self, objects: Iterable[DetectedObject], time_s: float) -> tuple[int, ...]:
        """Identities of the objects (in pixels of the picture the region was made for) that stand; after `observe`."""
        found = tuple(objects)
        boxes = np.array([[o.x, o.y, o.w, o.h] for o in found], float).reshape(-1, 4)
        boxes = self._roi.to_working(boxes)
        for one, box, look in zip(found, boxes, self._meter.look(boxes), strict=True):
            known = self._known.setdefault(one.id, _Known(time_s))
            known.last_s = time_s
            known.way.append((time_s, box[:2]))
            self._learn(known, box, _stands(known, look), time_s)
            while known.way[0][0] < time_s - LONGEST_LOOK_S:
                known.way.popleft()
        self._known = {i: k for i, k in self._known.items() if time_s - k.last_s <= RODE_S}
        self._places = [(s, box) for s, box in self._places if time_s - s <= REMEMBERED_S]
        return tuple(one.id for one in found if self._known[one.id].stands)

    def _learn(self, known: _Known, box: NDArray[np.float64], stands: bool | None, time_s: float) -> None:
        if stands:
            known.stands_since_s = time_s if known.stands_since_s is None else known.stands_since_s
            if time_s - known.stands_since_s >= (RODE_S if known.rode else 0.0) - 1e-6:
                known.stands = True
                self._forget(box)
                self._places.append((time_s, box))
            return
        # What is found where something stood is taken for the same until it is seen to ride, whatever its place looks
        # like: letters look like what lies behind them. With the belt at rest nothing can be told at all.
        again = not known.rode and any(_shared(box, place) >= SAME_PLACE for _, place in self._places)
        if stands is None:
            known.stands |= again
        else:
            known.stands, known.stands_since_s = again, None

    def _forget(self, box: NDArray[np.float64]) -> None:
        self._places = [(s, place) for s, place in self._places if _shared(box, place) < SAME_PLACE]


def _stands(known: _Known, look: PlaceLook | None) -> bool | None:
    """By its own way where it was there for long enough, by what its place looks like where it was not.

    The longer way says more: boxes on letters, say, jump to and fro by what looks like riding for a moment.
    """
    if look is None:
        return None
    share = _ridden(known, look.far_since_s, look.far_moved)
    if share is None or _STAYED <= share <= _RODE:
        share = _ridden(known, look.since_s, look.moved)
    if share is None:
        return look.same
    if share > _RODE:
        known.rode = True
        return False
    return True if share < _STAYED else look.same


def _ridden(known: _Known, since_s: float, moved: NDArray[np.float64]) -> float | None:
    """Its way since then as a share of the belt's; None where it was not there yet."""
    then = next((centre for time_s, centre in reversed(known.way) if time_s <= since_s + 1e-6), None)
    return None if then is None else float((known.way[-1][1] - then) @ moved) / float(moved @ moved)


def _shared(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """`shared` of boxes given by centre and size (4,)."""
    low_a, low_b = a[:2] - a[2:] / 2, b[:2] - b[2:] / 2
    return shared(low_a.tolist(), a[2:].tolist(), low_b.tolist(), b[2:].tolist())
