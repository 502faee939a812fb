"""The key expressions of the bus, built and taken apart. Version 1 of the contract."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

_ROOT = "lumpwatch/v1"
_CHUNK = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")


class Kind(StrEnum):
    """What a key carries; those of commands are named by the table in `lumpwatch.service.protocol.commands`."""

    FRAME = "frame"
    JPEG = "frame/jpeg"
    TEST_FRAME = "blended"
    BLEND = "blend"
    HEARTBEAT = "heartbeat"
    STATE = "state"
    ALARM = "alarm"
    LEVEL = "level"
    TEST = "test"
    SHADOW = "shadow"
    ALIVE = "@alive"


_OF_CAMERA = frozenset({Kind.FRAME, Kind.JPEG, Kind.TEST_FRAME, Kind.BLEND, Kind.HEARTBEAT})
_OF_ROI = frozenset({Kind.STATE, Kind.ALARM, Kind.LEVEL, Kind.TEST, Kind.SHADOW})

KEY_OF: dict[Kind, str] = {
    kind: f"{_ROOT}/{{site}}/{{camera}}/{kind}"
    if kind in _OF_CAMERA
    else f"{_ROOT}/{{site}}/{{camera}}/{{roi}}/{kind}"
    for kind in (*sorted(_OF_CAMERA), *sorted(_OF_ROI))
} | {Kind.ALIVE: f"{_ROOT}/{{site}}/{Kind.ALIVE}/{{role}}/{{name}}"}
"""The pattern of the keys of each kind."""


@dataclass(frozen=True, slots=True)
class Address:
    """The parts of a key; those that its kind does not have are empty."""

    site: str
    kind: Kind
    camera: str = ""
    roi: str = ""
    role: str = ""
    name: str = ""


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one site. All methods raise ValueError for a name that cannot be part of a key."""

    site: str

    def __post_init__(self) -> None:
        _chunk(self.site)

    def frame(self, camera: str) -> str:
        """Frames as the monitor uses them."""
        return self._of_camera(camera, Kind.FRAME)

    def jpeg(self, camera: str) -> str:
        """Whole pictures as JPEG, for people."""
        return self._of_camera(camera, Kind.JPEG)

    def test_frame(self, camera: str) -> str:
        """Frames with the synthetic lump of a proof test."""
        return self._of_camera(camera, Kind.TEST_FRAME)

    def blend(self, camera: str) -> str:
        """Query that asks the camera's process for those."""
        return self._of_camera(camera, Kind.BLEND)

    def heartbeat(self, camera: str) -> str:
        """Signs of life of the camera process."""
        return self._of_camera(camera, Kind.HEARTBEAT)

    def state(self, camera: str, roi: str) -> str:
        """State of the ROI, one message a frame."""
        return self._of_roi(camera, roi, Kind.STATE)

    def alarm(self, camera: str, roi: str) -> str:
        """Transitions of the ROI's alarm."""
        return self._of_roi(camera, roi, Kind.ALARM)

    def level(self, camera: str, roi: str) -> str:
        """The least that a PLC gateway needs of the ROI."""
        return self._of_roi(camera, roi, Kind.LEVEL)

    def region(self, camera: str, roi: str) -> str:
        """What the keys of a ROI begin with."""
        return f"{self._root}/{_chunk(camera)}/{_chunk(roi)}"

    def command(self, camera: str, roi: str, name: str) -> str:
        """Query by which a command is given to the ROI."""
        return f"{self.region(camera, roi)}/{_chunk(name)}"

    def commands(self, name: str, camera: str = "*") -> str:
        """Selector: one command of all ROIs, or of those of a camera."""
        return f"{self._root}/{camera if camera == '*' else _chunk(camera)}/*/{_chunk(name)}"

    def test(self, camera: str, roi: str) -> str:
        """Alarms of the ROI's proof tests."""
        return self._of_roi(camera, roi, Kind.TEST)

    def shadow(self, camera: str, roi: str) -> str:
        """State of the prior that runs in shadow on the ROI, while one does."""
        return self._of_roi(camera, roi, Kind.SHADOW)

    def alive(self, role: str, name: str) -> str:
        """Liveliness token of a process."""
        return f"{self._root}/{Kind.ALIVE}/{_chunk(role)}/{_chunk(name)}"

    def all_alive(self) -> str:
        """Selector: the liveliness tokens of all processes."""
        return f"{self._root}/{Kind.ALIVE}/**"

    def frames(self) -> str:
        """Selector: the frames of all cameras."""
        return f"{self._root}/*/{Kind.FRAME}"

    def heartbeats(self) -> str:
        """Selector: the heartbeats of all cameras."""
        return f"{self._root}/*/{Kind.HEARTBEAT}"

    def states(self) -> str:
        """Selector: the states of all ROIs."""
        return f"{self._root}/*/*/{Kind.STATE}"

    def alarms(self) -> str:
        """Selector: the alarms of all ROIs."""
        return f"{self._root}/*/*/{Kind.ALARM}"

    def levels(self) -> str:
        """Selector: the levels of all ROIs."""
        return f"{self._root}/*/*/{Kind.LEVEL}"

    def tests(self) -> str:
        """Selector: the alarms of all proof tests."""
        return f"{self._root}/*/*/{Kind.TEST}"

    @property
    def _root(self) -> str:
        return f"{_ROOT}/{self.site}"

    def _of_camera(self, camera: str, kind: Kind) -> str:
        return f"{self._root}/{_chunk(camera)}/{kind}"

    def _of_roi(self, camera: str, roi: str, kind: Kind) -> str:
        return f"{self.region(camera, roi)}/{kind}"


def command_key(name: str) -> str:
    """The pattern of the keys of a command."""
    return f"{_ROOT}/{{site}}/{{camera}}/{{roi}}/{_chunk(name)}"


def on_every_site(kind: str) -> str:
    """Selector: all keys of a kind or command, whatever their site, camera and ROI."""
    return f"{_ROOT}/*/{kind}/**" if kind is Kind.ALIVE else f"{_ROOT}/*/**/{kind}"


def parse(key: str) -> Address:
    """Take a key (not a selector) apart; raises ValueError for a key that is no message's of this contract."""
    prefix = f"{_ROOT}/"
    parts = key.removeprefix(prefix).split("/")
    if not key.startswith(prefix) or not 3 <= len(parts) <= 4:
        raise ValueError(f"'{key}' is not a key of {_ROOT}")
    site = _chunk(parts[0])
    if parts[1] == Kind.ALIVE and len(parts) == 4:
        return Address(site, Kind.ALIVE, role=_chunk(parts[2]), name=_chunk(parts[3]))
    camera = _chunk(parts[1])
    tail = "/".join(parts[2:])
    if tail in _OF_CAMERA:
        return Address(site, Kind(tail), camera)
    if len(parts) == 4 and parts[3] in _OF_ROI:
        return Address(site, Kind(parts[3]), camera, roi=_chunk(parts[2]))
    raise ValueError(f"'{key}' is not a key of {_ROOT}")


def _chunk(name: str) -> str:
    if not _CHUNK.fullmatch(name):
        raise ValueError(f"'{name}' cannot be part of a bus key")
    return name
