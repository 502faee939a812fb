"""Which rocks are where: lumps and other rocks that ride on the belt and fall off its end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from lumpwatch.service.simulator.gaps import Gaps
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.shape import Shape
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.stock import Rolling, Stock

_LUMP, _MEDIUM, _NEAR = 2, 3, 9
_EXTRA, _TOUCH, _CLUSTER, _STUCK = 10, 11, 12, 24  # generators of what is off by default
_ROOM = 0.6  # rocks keep this share of the sum of their radii apart


@dataclass(frozen=True, slots=True)
class Rock:
    """A rock at one moment. `id` counts the lumps from 1; 0 for any other rock. Lengths in mm."""

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
    rolling: Rolling | None = None
    stuck_at: float | None = None
    """How long it falls until it lodges in the mouth, seconds; None: it does not."""
    slip: float = 0.0
    """How much faster than the belt it moves, as a share of the belt's speed."""


class Traffic:
    """All rocks of a feed; `at` moves on to a later time.

    Every rock is drawn from a generator of its own, and positions follow from the distance that the
    belt has come, so what happens when does not depend on how often `at` is called.
    """

    def __init__(
        self, spec: FeedSpec, geometry: Geometry, belt: BeltMotion, stock: Stock, gaps: Gaps
    ) -> None:
        self._spec, self._geometry, self._belt, self._stock = spec, geometry, belt, stock
        self._gaps = gaps
        self._largest = spec.largest_lump * spec.limit_mm
        # The largest lump's lower edge enters the picture when its centre is here (negative).
        self._entry = geometry.entry_y(self._largest / 2) - 100.0
        self._flat = geometry.foreshortening(geometry.belt_length_mm / 2)
        # Lumps are laid out further ahead, so that other rocks can leave them room.
        self._ahead = 2 * self._largest + (4 * spec.limit_mm if spec.cluster_share > 0 else 0.0)
        self._active: list[Rock] = []
        self._rates = {
            _LUMP: spec.lumps_per_minute,
            _MEDIUM: spec.medium_rocks_per_minute,
            _NEAR: spec.near_limit_rocks_per_minute,
        }
        self._sizes = {
            _LUMP: (spec.smallest_lump, spec.largest_lump),
            _MEDIUM: (0.3, 0.7),
            _NEAR: (0.7, 1.0),
        }
        self._drawn = dict.fromkeys(self._rates, 0)
        self._next = {kind: self._gap(kind, 0) for kind in self._rates}
        self._next[_MEDIUM] -= geometry.belt_length_mm
        self._last_lump: Rock | None = None
        self._paired = False
        self.lodged: list[tuple[int, float]] = []
        """Lumps that have lodged in the mouth so far, and when they came to rest there."""

    def at(self, t: float) -> tuple[Rock, ...]:
        """The rocks near and in the picture at time t, farthest first; t must not decrease."""
        distance = self._belt.distance(t)
        self._extend(_LUMP, distance - self._entry + self._ahead)
        self._extend(_NEAR, distance - self._entry + self._largest)
        self._extend(_MEDIUM, distance - self._entry)
        moved = (self._move(rock, t, distance) for rock in self._active)
        self._active = [rock for rock in moved if self._present(rock)]
        return tuple(sorted(self._active, key=lambda rock: rock.y))

    def _extend(self, kind: int, until: float) -> None:
        while self._rates[kind] > 0 and self._next[kind] <= until:
            self._drawn[kind] += 1
            number = self._drawn[kind]
            rock = self._draw(kind, number, self._next[kind])
            if self._gaps.bare(rock.start, rock.size_mm):
                pass  # nothing lies there
            elif kind == _LUMP:
                rock = self._among_others(rock)
                self._next[kind] = rock.start
                self._active += [rock, *self._cluster(rock)]
            elif self._has_room(rock):
                self._active.append(rock)
            self._next[kind] += self._gap(kind, number)

    def _gap(self, kind: int, number: int) -> float:
        """Distance on the belt from rock `number` to the next, mm."""
        spec, rng = self._spec, np.random.default_rng([self._spec.seed, kind, number, 0])
        if (rate := self._rates[kind]) == 0:
            return 0.0
        mean = 60 / rate
        if kind == _LUMP and spec.touching_share > 0:
            if self._touched(number):
                return 0.0
            mean /= 1 - spec.touching_share  # the number a minute stays
        least = min(spec.lump_spacing_s, 0.6 * mean) if kind == _LUMP else 0.0
        if number == 0:
            least = 0.0
        return float(least + rng.exponential(mean - least)) * spec.belt_speed_mm_s

    def _draw(self, kind: int, number: int, start: float) -> Rock:
        spec, rng = self._spec, np.random.default_rng([self._spec.seed, kind, number, 1])
        low, high = self._sizes[kind]
        size = float(rng.uniform(low, high)) * spec.limit_mm
        index = int(rng.integers(len(self._stock.plain)))
        rolling, slip, shape = None, 0.0, self._stock.plain[index]
        if kind != _MEDIUM:
            extra = self._rng(_EXTRA, kind, number)
            buried, rolls, direction = extra.random(3) < (spec.buried_share, spec.roll_share, 0.5)
            alone = not (self._touched(number) or self._touched(number - 1))
            if kind == _LUMP and rolls and alone and not buried:
                rolling = self._stock.rolling(extra)
                slip = float(extra.uniform(0.4, 1.0)) * spec.roll_slip * (1 if direction else -1)
                shape = rolling.shape(0.0, size * self._geometry.a)
            else:
                shape = self._stock.lump(extra, index, bool(buried))
        room = self._room(shape, size)
        tone = float(rng.uniform(0.85, 1.2))
        x = float(rng.uniform(-room, room))
        if kind != _MEDIUM and spec.lump_contrast < 1:
            tone = 1 + (tone - 1) * spec.lump_contrast
        rock = Rock(
            id=number if kind == _LUMP else 0,
            shape=shape,
            tone=tone,
            size_mm=size,
            x=x,
            start=start,
            release_y=self._geometry.release_y(shape.half_height * size),
            rolling=rolling,
            slip=slip,
        )
        return rock if rolling is None else replace(rock, release_y=self._release_rolling(rock, rolling))

    def _release_rolling(self, rock: Rock, rolling: Rolling) -> float:
        y = rock.release_y
        for _ in range(6):  # its height at the lip depends on how far it has come: converges fast
            y = self._geometry.release_y(rolling.half_height(_angle(rock, y)) * rock.size_mm)
        return y

    def _room(self, shape: Shape, size: float) -> float:
        """How far from the middle of the belt a rock's middle may lie, mm."""
        return max(self._spec.belt_width_mm / 2 - 1.05 * shape.half_width * size, 0.0)

    def _rng(self, *stream: int) -> Generator:
        return np.random.default_rng([self._spec.seed, *stream])

    def _touched(self, number: int) -> bool:
        """Whether lump `number` is touched by the next one."""
        share = self._spec.touching_share
        return share > 0 and number > 0 and float(self._rng(_TOUCH, number).random()) < share

    def _among_others(self, lump: Rock) -> Rock:
        """The lump, moved to where it touches the one before if it is to."""
        other, paired = self._last_lump, self._paired
        self._last_lump, self._paired = lump, False
        if other is None or not self._touched(lump.id - 1):
            return lump
        room = self._room(lump.shape, lump.size_mm)
        beside = lump.shape.half_width * lump.size_mm + other.shape.half_width * other.size_mm
        x = other.x - np.copysign(0.96 * beside, other.x)
        start = other.start
        self._paired = abs(x) <= room and not paired
        if not self._paired:  # no room beside it: behind it
            behind = lump.shape.half_height * lump.size_mm + other.shape.half_height * other.size_mm
            x = np.clip(other.x, -room, room)
            start += 0.96 * behind / self._flat
        self._last_lump = replace(lump, x=float(x), start=start)
        return self._last_lump

    def _cluster(self, lump: Rock) -> list[Rock]:
        """Medium rocks around a lump."""
        if self._spec.cluster_share == 0:
            return []
        rng = self._rng(_CLUSTER, lump.id)
        if rng.random() >= self._spec.cluster_share:
            return []
        count = int(rng.integers(6, 10))
        rocks = []
        for angle in (np.arange(count) + rng.uniform(-0.2, 0.2, count)) * 2 * np.pi / count:
            size = float(rng.uniform(0.3, 0.65)) * self._spec.limit_mm
            shape = self._stock.plain[int(rng.integers(len(self._stock.plain)))]
            dx = np.cos(angle) * (lump.shape.half_width * lump.size_mm + shape.half_width * size)
            dv = np.sin(angle) * (lump.shape.half_height * lump.size_mm + shape.half_height * size)
            rock = Rock(
                id=0,
                shape=shape,
                tone=float(rng.uniform(0.85, 1.2)),
                size_mm=size,
                x=float(lump.x + dx),
                start=float(lump.start - dv / self._flat),
                release_y=self._geometry.release_y(shape.half_height * size),
            )
            if abs(rock.x) <= self._room(shape, size):
                rocks.append(rock)
        return rocks

    def _has_room(self, rock: Rock) -> bool:
        return all(
            np.hypot(rock.x - other.x, rock.start - other.start) > _ROOM * (rock.size_mm + other.size_mm) / 2
            for other in self._active
        )

    def _move(self, rock: Rock, t: float, distance: float) -> Rock:
        pace = 1 + rock.slip
        y = pace * (distance - rock.start)
        if y < rock.release_y:
            return self._turn(replace(rock, y=y))
        if rock.released_at is None:
            at = self._belt.time_at(rock.start + rock.release_y / pace, before=t)
            rock = replace(rock, released_at=at, released_speed=pace * self._belt.speed(at))
            if rock.id and self._lodges(rock.id):
                rock = replace(rock, stuck_at=self._falls_to_mouth(rock))
                assert rock.stuck_at is not None
                self.lodged.append((rock.id, at + rock.stuck_at))
        assert rock.released_at is not None
        s = t - rock.released_at
        if rock.stuck_at is not None:
            s = max(min(s, rock.stuck_at), s - self._spec.stuck_duration_s)
        z = -self._spec.gravity_mm_s2 * s * s / 2
        return self._turn(replace(rock, y=rock.release_y + rock.released_speed * s, z=z, fallen_s=s))

    def _lodges(self, number: int) -> bool:
        share = self._spec.stuck_share
        return share > 0 and float(self._rng(_STUCK, number).random()) < share

    def _falls_to_mouth(self, rock: Rock) -> float:
        """How long a rock falls until its middle is half way between lip and rim, seconds."""
        row = (self._geometry.lip_row + self._geometry.rim_row) / 2
        low, high = 0.0, 2.0
        for _ in range(40):
            s = (low + high) / 2
            y, z = rock.release_y + rock.released_speed * s, -self._spec.gravity_mm_s2 * s * s / 2
            low, high = (s, high) if self._geometry.project(rock.x, y, z)[1] < row else (low, s)
        return high

    def _turn(self, rock: Rock) -> Rock:
        if rock.rolling is None or rock.y < self._entry:
            return rock
        _, _, scale = self._geometry.project(rock.x, rock.y, rock.z)
        return replace(rock, shape=rock.rolling.shape(_angle(rock, rock.y), rock.size_mm * scale))

    def _present(self, rock: Rock) -> bool:
        if rock.y < 0:
            return True
        _, v, scale = self._geometry.project(rock.x, rock.y, rock.z)
        return v - rock.shape.half_height * rock.size_mm * scale < self._geometry.rim_row


def _angle(rock: Rock, y: float) -> float:
    """How far a rolling rock has turned at y: it rolls off what it gains on the belt."""
    return rock.slip / (1 + rock.slip) * y / (rock.size_mm / 2)
