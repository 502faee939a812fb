"""The register map: which value lies where. It is published, and stable by rule.

Input registers: 64 for the site, then a block of 64 for each region, in the order of the map. A new value takes the
next free register of its block; nothing ever moves, and what is free reads "not available". Holding registers are a
copy for masters that read nothing else; they cannot be written. Coils lie in blocks of 16 in the same way.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import AlarmClass, AlarmState, Decision
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.gateway.codes import (
    ALARM_STATES,
    BLIND_REASONS,
    DECISIONS,
    FEED_STATES,
    OTHER,
    SEES,
    listed,
)
from lumpwatch.service.gateway.values import Quality, RegionValues, SiteValues, Why

MAP_VERSION = 2
"""Rises when values are added."""
BLOCK, COILS = 64, 16
"""Registers, and coils, of a block."""
NOT_AVAILABLE_16, NOT_AVAILABLE_32 = 0xFFFF, 0xFFFFFFFF
MOST_REGIONS = 65536 // BLOCK - 1

Table = Literal["input", "holding", "coil"]
Type = Literal["uint16", "uint32", "bool"]


@dataclass(frozen=True, slots=True)
class Point:
    """One value of the map. What it stands for is the register divided by `scale`."""

    name: str
    table: Table
    address: int
    type: Type
    unit: str
    scale: int
    about: str

    def plain(self) -> dict[str, Any]:
        """As a mapping."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class _Value:
    """A value of each region: where in its block, and how it is read off."""

    at: int
    name: str
    type: Type
    unit: str
    scale: int
    about: str
    read: Callable[[RegionValues], float | None]


@dataclass(frozen=True, slots=True)
class Coil:
    """A coil of each region."""

    at: int
    name: str
    about: str


_NONE = f"{NOT_AVAILABLE_16}: not available"


def _alarm(alarm_class: AlarmClass) -> Callable[[RegionValues], float | None]:
    return lambda region: _coded(region.alarms.get(alarm_class), ALARM_STATES)


def _blind_reason(region: RegionValues) -> float | None:
    if region.blind_reason is not None:
        return BLIND_REASONS.get(region.blind_reason, OTHER)
    return SEES if region.quality is not Quality.BAD else None


def _coded(word: str | None, codes: dict[str, int]) -> int | None:
    return None if word is None else codes.get(word, OTHER)


STATE_BITS = (
    (
        "CLEAR",
        "seen, judged, quality Good, and no sign of a lump or a blockage: the only bit that may release anything",
    ),
    ("LUMP", "the region decides LUMP, or the condition of the lump alarm is active"),
    ("BLIND", "the region says that it cannot see"),
    ("GOOD", "quality is Good"),
    ("LIVES", "the whole chain lives; the heartbeat of the region rises"),
    ("LUMP_ALARM", "the lump alarm is announced: UNACKNOWLEDGED or ACKNOWLEDGED"),
    ("BLIND_ALARM", "the blind alarm is announced"),
    ("SYSTEM_ALARM", "the system alarm is announced"),
    ("WAITS", "an alarm waits for an acknowledgement"),
    ("HELD", "an alarm is shelved, suppressed or out of service"),
    ("TRAINED", "the region has a prior of its site"),
    ("BLOCKED", "the region decides BLOCKED, or the condition of the blocked alarm is active"),
)
"""The bits of the state word, from bit 0. None is set when nothing is known: 0 is the safe state."""


_HELD = (AlarmState.SHELVED, AlarmState.SUPPRESSED, AlarmState.OUT_OF_SERVICE)


def state_word(region: RegionValues) -> int:
    """The state of a region in bits."""
    stands = region.alarms
    announced = {alarm_class for alarm_class, state in stands.items() if state.active}
    waits = any(state in (AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED) for state in stands.values())
    held = any(state in _HELD for state in stands.values())
    bits = (
        region.clear,
        region.decision is Decision.LUMP or region.lump is True,
        region.decision is Decision.BLIND,
        region.quality is Quality.GOOD,
        region.lives,
        AlarmClass.LUMP in announced,
        AlarmClass.BLIND in announced,
        AlarmClass.SYSTEM in announced,
        waits,
        held,
        region.trained is True,
        region.decision is Decision.BLOCKED or region.blocked is True,
    )
    return sum(1 << i for i, bit in enumerate(bits) if bit)


_WHYS = ", ".join(f"{why.value} {why.name.lower()}" for why in Why)
_VALUES = (
    _Value(0, "state", "uint16", "bits", 1,
           "; ".join(f"bit {i} {name}: {about}" for i, (name, about) in enumerate(STATE_BITS)), state_word),
    _Value(1, "quality", "uint16", "", 1,
           "192 Good: sees and its heartbeat is valid; 64 Uncertain; 0 Bad", lambda r: r.quality),
    _Value(2, "quality_reason", "uint16", "", 1, f"why: {_WHYS}", lambda r: r.why),
    _Value(3, "heartbeat", "uint16", "", 1,
           "rises four times a second while the whole chain lives, 1 to 65535 and again from 1; 0: not yet",
           lambda r: r.heartbeat),
    _Value(4, "decision", "uint16", "", 1, f"{listed(DECISIONS)}; {_NONE}", lambda r: _coded(r.decision, DECISIONS)),
    _Value(5, "blind_reason", "uint16", "", 1, f"{SEES} sees, {listed(BLIND_REASONS)}; {_NONE}", _blind_reason),
    _Value(6, "alarm", "uint16", "", 1, f"lump alarm: {listed(ALARM_STATES)}; {_NONE}", _alarm(AlarmClass.LUMP)),
    _Value(7, "blind_alarm", "uint16", "", 1, "blind alarm, in the same numbers", _alarm(AlarmClass.BLIND)),
    _Value(8, "system_alarm", "uint16", "", 1, "system alarm, in the same numbers", _alarm(AlarmClass.SYSTEM)),
    _Value(9, "existence", "uint16", "", 1000, f"probability that a lump is there; {_NONE}", lambda r: r.existence),
    _Value(10, "count", "uint16", "", 1, f"lumps that are located and count for the alarm; {_NONE}", lambda r: r.count),
    _Value(11, "largest", "uint16", "mm", 1,
           f"longest diameter of the largest of them; {NOT_AVAILABLE_16}: none, or no calibration",
           lambda r: r.largest_mm),
    _Value(12, "lip", "uint16", "s", 10,
           f"until the first of them reaches the lip; {NOT_AVAILABLE_16}: none, or not known", lambda r: r.lip_s),
    _Value(13, "speed", "uint16", "mm/s", 1, f"speed of that one; {NOT_AVAILABLE_16}: none, or no calibration",
           lambda r: r.speed_mm_s),
    _Value(14, "size_limit", "uint16", "mm", 1, f"configured size limit; {NOT_AVAILABLE_16}: none",
           lambda r: r.limit_mm),
    _Value(16, "prior", "uint32", "", 1,
           f"version of the prior in use, 0: the stated defaults; {NOT_AVAILABLE_32}: not available",
           lambda r: r.prior),
    _Value(18, "sequence", "uint32", "", 1,
           f"of the last alarm record, 0: there was none; {NOT_AVAILABLE_32}: not available", lambda r: r.sequence),
    _Value(20, "blocked_alarm", "uint16", "", 1, "blocked alarm, in the same numbers",
           _alarm(AlarmClass.BLOCKED)),
    _Value(21, "feed_state", "uint16", "", 1, f"{listed(FEED_STATES)}; {_NONE}",
           lambda r: _coded(r.feed.state, FEED_STATES)),
    _Value(22, "feed_speed", "uint16", "mm/s", 1, f"speed of the belt; {_NONE}", lambda r: r.feed.speed_mm_s),
    _Value(23, "load", "uint16", "", 1000, f"share of the belt that is covered; {_NONE}", lambda r: r.feed.load),
    _Value(24, "visible_p80", "uint16", "mm", 1,
           f"size below which four fifths of the visible stones' area lie, a trend; {_NONE}",
           lambda r: r.feed.visible_p80_mm),
    _Value(25, "mouth_standing", "uint16", "", 1000,
           f"share of the mouth in which material stands; {_NONE}, or no mouth", lambda r: r.mouth.standing),
    _Value(26, "mouth_stood", "uint16", "s", 10,
           f"for how long enough of it has stood while the feed ran; {_NONE}, or no mouth", lambda r: r.mouth.stood_s),
)  # fmt: skip

ACKNOWLEDGES: dict[str, AlarmClass] = {"ack": AlarmClass.LUMP} | {
    f"ack_{alarm_class}": alarm_class for alarm_class in AlarmClass if alarm_class is not AlarmClass.LUMP
}
"""Coils that acknowledge, and the alarm that they are about."""
FEEDER, MAINTENANCE = "feeder_runs", "maintenance"
_ACK_AT = {"ack": 0, "ack_blind": 1, "ack_system": 2, "ack_blocked": 3}
"""For ever, too."""
REGION_COILS = (
    *(
        Coil(
            _ACK_AT[name],
            name,
            f"write 1: acknowledge the {alarm_class} alarm; reads 1 until the answer is there; 0 is ignored",
        )
        for name, alarm_class in ACKNOWLEDGES.items()
    ),
    Coil(
        8,
        FEEDER,
        "the plant's signal that the feeder runs; to be written at least every `gateway.plant.valid_s`",
    ),
    Coil(9, MAINTENANCE, "the plant's signal that the machine is in maintenance; likewise"),
)
"""Coils of each region."""

_SITE_VALUES: tuple[tuple[str, str, Callable[[SiteValues, int], int]], ...] = (
    ("map_version", "version of this map; rises when values are added", lambda s, _: MAP_VERSION),
    (
        "heartbeat",
        "rises four times a second while the chains of all regions live, 1 to 65535 and again from 1; 0: not yet",
        lambda s, _: s.heartbeat,
    ),
    ("quality", "the worst of all regions: 192 Good, 64 Uncertain, 0 Bad", lambda s, _: s.quality),
    ("regions", "how many regions there are", lambda s, _: len(s.regions)),
    (
        "layout",
        "checksum of names and addresses of this map: another one means that the configuration's regions changed",
        lambda s, layout: layout,
    ),
)


class RegisterMap:
    """The map of one configuration. Raises ConfigError where it has more regions than addresses."""

    def __init__(self, config: SiteConfig) -> None:
        configured = [(camera.id, roi.id) for camera in config.cameras for roi in camera.rois]
        first = [tuple(name.split("/")) for name in config.gateway.order]
        self.regions: tuple[tuple[str, str], ...] = tuple(
            [(camera, roi) for camera, roi in first] + [where for where in configured if where not in first]
        )
        """Camera and ROI in the order of the map."""
        if len(self.regions) > MOST_REGIONS:
            raise ConfigError(
                f"cameras: {len(self.regions)} regions, but the map has room for {MOST_REGIONS}"
            )
        self.points: tuple[Point, ...] = (
            *self._coils(),
            *self._registers("holding"),
            *self._registers("input"),
        )
        """All values; holding registers have the names and addresses of the input registers."""
        named = "\n".join(f"{point.table} {point.address} {point.name}" for point in self.points)
        self.layout = zlib.crc32(named.encode()) & 0xFFFF or 1
        """Checksum of the names and addresses."""
        self.size = BLOCK * (1 + len(self.regions))
        """How many registers there are."""

    def words(self, values: SiteValues) -> tuple[int, ...]:
        """The content of all registers."""
        words = [NOT_AVAILABLE_16] * self.size
        for at, (_, _, read) in enumerate(_SITE_VALUES):
            words[at] = int(read(values, self.layout))
        for i, region in enumerate(values.regions):
            base = BLOCK * (i + 1)
            for value in _VALUES:
                if value.type == "uint32":
                    number = _scaled(value.read(region), 1, NOT_AVAILABLE_32)
                    words[base + value.at : base + value.at + 2] = [number >> 16, number & 0xFFFF]
                else:
                    words[base + value.at] = _scaled(value.read(region), value.scale, NOT_AVAILABLE_16)
        return tuple(words)

    def numbers(self, values: SiteValues) -> Iterator[tuple[str, float | None, bool]]:
        """Every value by name, in its unit; None: not available. Whether it may have a fraction comes third."""
        for name, _, read in _SITE_VALUES:
            yield name, read(values, self.layout), False
        for region in values.regions:
            for value in _VALUES:
                yield f"{region.name}/{value.name}", value.read(region), value.scale > 1

    def coil(self, address: int) -> tuple[tuple[str, str], str] | None:
        """Region and name of the coil at an address; None where there is none."""
        block, at = divmod(address, COILS)
        if not 1 <= block <= len(self.regions):
            return None
        name = next((coil.name for coil in REGION_COILS if coil.at == at), None)
        return None if name is None else (self.regions[block - 1], name)

    @property
    def coils(self) -> int:
        """How many coils there are."""
        return COILS * (1 + len(self.regions))

    def _registers(self, table: Table) -> Iterator[Point]:
        for at, (name, about, _) in enumerate(_SITE_VALUES):
            yield Point(name, table, at, "uint16", "", 1, about)
        for i, (camera, roi) in enumerate(self.regions):
            for v in _VALUES:
                address = BLOCK * (i + 1) + v.at
                yield Point(f"{camera}/{roi}/{v.name}", table, address, v.type, v.unit, v.scale, v.about)

    def _coils(self) -> Iterator[Point]:
        for i, (camera, roi) in enumerate(self.regions):
            for coil in REGION_COILS:
                address = COILS * (i + 1) + coil.at
                yield Point(f"{camera}/{roi}/{coil.name}", "coil", address, "bool", "", 1, coil.about)


def _scaled(value: float | None, scale: int, none: int) -> int:
    """A register's content; what is too large reads as the largest value, since `none` has a meaning of its own."""
    if value is None or value != value:
        return none
    return min(max(0, round(value * scale)), none - 1)
