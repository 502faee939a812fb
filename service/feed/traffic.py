"""Which rocks are where: lumps and medium rocks that ride on the belt and fall off its end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from service.feed.geometry import Geometry
from service.feed.motion import BeltMotion
from service.feed.spec import FeedSpec
from service.feed.sprites import Shape

_LUMP, _MEDIUM = 2, 3
_ROOM = 0.6  # rocks keep this share of the sum of their radii apart


@dataclass(frozen=True, slots=True)
class Rock:
    """A rock at one moment. `id` counts the lumps from 1; 0 for a medium rock. Lengths in mm."""

    id: int
    shape: Shape
    tone: float
    size_mm: float
    x: float
    start: float
    """How far the belt has come when the rock passes y = 0."""
    release_y: float
    """y at which it begins to fall: its lower edge is at the lip in the picture."""
    y: float = 0.0
    z: float = 0.0
    fallen_s: float = 0.0
    """Time since it began to fall; 0 while it rides."""
    released_at: float | None = None
    released_speed: float = 0.0


class Traffic:
    """All rocks of a feed; `at` moves on to a later time.

    Every rock is drawn from a generator of its own, and positions follow from the distance that the
    belt has come, so what happens when does not depend on how often `at` is called.
    """

    def __init__(
        self, spec: FeedSpec, geometry: Geometry, belt: BeltMotion, shapes: tuple[Shape, ...]
    ) -> None:
        self._spec, self._geometry, self._belt, self._shapes = spec, geometry, belt, shapes
        self._largest = spec.largest_lump * spec.limit_mm
        # The largest lump's lower edge enters the picture when its centre is here (negative).
        self._entry = geometry.entry_y(self._largest / 2) - 100.0
        self._active: list[Rock] = []
        self._drawn = {_LUMP: 0, _MEDIUM: 0}
        self._next = {
            _LUMP: self._gap(_LUMP, 0),
            _MEDIUM: self._gap(_MEDIUM, 0) - geometry.belt_length_mm,
        }

    def at(self, t: float) -> tuple[Rock, ...]:
        """The rocks near and in the picture at time t, farthest first; t must not decrease."""
        distance = self._belt.distance(t)
        # Lumps are laid out further ahead, so that medium rocks can leave them room.
        self._extend(_LUMP, distance - self._entry + 2 * self._largest)
        self._extend(_MEDIUM, distance - self._entry)
        moved = (self._move(rock, t, distance) for rock in self._active)
        self._active = [rock for rock in moved if self._present(rock)]
        return tuple(sorted(self._active, key=lambda rock: rock.y))

    def _extend(self, kind: int, until: float) -> None:
        rate = self._spec.lumps_per_minute if kind == _LUMP else self._spec.medium_rocks_per_minute
        while rate > 0 and self._next[kind] <= until:
            self._drawn[kind] += 1
            rock = self._draw(kind, self._drawn[kind], self._next[kind])
            if kind == _LUMP or self._has_room(rock):
                self._active.append(rock)
            self._next[kind] += self._gap(kind, self._drawn[kind])

    def _gap(self, kind: int, number: int) -> float:
        """Distance on the belt from rock `number` to the next, mm."""
        spec, rng = self._spec, np.random.default_rng([self._spec.seed, kind, number, 0])
        rate = spec.lumps_per_minute if kind == _LUMP else spec.medium_rocks_per_minute
        if rate == 0:
            return 0.0
        mean = 60 / rate
        least = min(spec.lump_spacing_s, 0.6 * mean) if kind == _LUMP else 0.0
        if number == 0:
            least = 0.0
        return float(least + rng.exponential(mean - least)) * spec.belt_speed_mm_s

    def _draw(self, kind: int, number: int, start: float) -> Rock:
        spec, rng = self._spec, np.random.default_rng([self._spec.seed, kind, number, 1])
        lump = kind == _LUMP
        low, high = (spec.smallest_lump, spec.largest_lump) if lump else (0.3, 0.7)
        size = float(rng.uniform(low, high)) * spec.limit_mm
        shape = self._shapes[int(rng.integers(len(self._shapes)))]
        room = max(spec.belt_width_mm / 2 - 1.05 * shape.half_width * size, 0.0)
        return Rock(
            id=number if lump else 0,
            shape=shape,
            tone=float(rng.uniform(0.85, 1.2)),
            size_mm=size,
            x=float(rng.uniform(-room, room)),
            start=start,
            release_y=self._geometry.release_y(shape.half_height * size),
        )

    def _has_room(self, rock: Rock) -> bool:
        return all(
            np.hypot(rock.x - other.x, rock.start - other.start) > _ROOM * (rock.size_mm + other.size_mm) / 2
            for other in self._active
        )

    def _move(self, rock: Rock, t: float, distance: float) -> Rock:
        y = distance - rock.start
        if y < rock.release_y:
            return replace(rock, y=y)
        if rock.released_at is None:
            at = self._belt.time_at(rock.start + rock.release_y, before=t)
            rock = replace(rock, released_at=at, released_speed=self._belt.speed(at))
        assert rock.released_at is not None
        s = t - rock.released_at
        z = -self._spec.gravity_mm_s2 * s * s / 2
        return replace(rock, y=rock.release_y + rock.released_speed * s, z=z, fallen_s=s)

    def _present(self, rock: Rock) -> bool:
        if rock.y < 0:
            return True
        _, v, scale = self._geometry.project(rock.x, rock.y, rock.z)
        return v - rock.shape.half_height * rock.size_mm * scale < self._geometry.rim_row
