"""The state of a ROI's filter at the start of a clip as bytes: a NumPy archive without pickle."""

from __future__ import annotations

import io
import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from lumpwatch.service.core import Alarm, AlarmClass, PaceState
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, alarm_of, load_arrays

if TYPE_CHECKING:
    from lumpwatch.service.detection import SightState, Snapshot

FORMAT = 1
_MOST_BYTES = 256 << 20
"""Unpacked; a million particles."""


class StateError(LumpwatchError):
    """A stored state cannot be read; the text names the file."""


def encode_state(snapshot: Snapshot) -> bytes:
    """The bytes of a state file; the prior is kept apart."""
    plain = {
        "format": FORMAT,
        "last_capture_s": snapshot.last_capture_s,
        "size": snapshot.size,
        "filter": None if snapshot.filter is None else snapshot.filter.plain,
        "looks": {str(i): asdict(track) for i, track in snapshot.sizes.items()},
        "sight": asdict(snapshot.sight),
        "pace": asdict(snapshot.pace),
        "camera_pace": asdict(snapshot.camera_pace),
        "alarms": {alarm_class.value: _alarm(alarm) for alarm_class, alarm in snapshot.alarms.items()},
    }
    arrays = {} if snapshot.filter is None else snapshot.filter.arrays
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8)
    np.savez_compressed(buffer, allow_pickle=False, plain=text, **arrays)
    return buffer.getvalue()


def decode_state(content: bytes, name: str, prior: Prior | None) -> Snapshot:
    """The reverse of `encode_state`; `name` stands for the file in errors. Raises StateError."""
    try:
        arrays: dict[str, Any] = load_arrays(content, _MOST_BYTES)
        plain = json.loads(arrays.pop("plain").tobytes())
        if plain["format"] == FORMAT:
            return _snapshot(plain, arrays, prior)
    except Exception as error:
        # Whatever is wrong with it, it is not a state that was written here.
        raise StateError(f"{name}: is not a filter state ({type(error).__name__})") from error
    raise StateError(f"{name}: has format {plain['format']}, this version reads format {FORMAT}")


def _snapshot(plain: dict[str, Any], arrays: dict[str, Any], prior: Prior | None) -> Snapshot:
    # Who answers for evidence or fetches it needs no filter.
    from lumpwatch.service.detection import FilterState, SizeTrack, Snapshot

    return Snapshot(
        plain["last_capture_s"],
        None if plain["size"] is None else (int(plain["size"][0]), int(plain["size"][1])),
        None if plain["filter"] is None else FilterState(plain["filter"], arrays),
        {int(i): SizeTrack(**track) for i, track in plain["looks"].items()},
        {
            AlarmClass(alarm_class): alarm_of(json.dumps(alarm))
            for alarm_class, alarm in plain["alarms"].items()
        },
        prior,
        _sight(plain.get("sight", {})),
        _pace(plain.get("pace", {})),
        _pace(plain.get("camera_pace", {})),
    )


def _sight(plain: dict[str, Any]) -> SightState:
    """States of before 0.2 have none: they begin as a start does."""
    from lumpwatch.service.detection import SightState

    return SightState(**plain | {"judged_s": tuple(plain.get("judged_s", ()))})


def _pace(plain: dict[str, Any]) -> PaceState:
    """States of before frames were passed over have none: the next one is decided on."""
    return PaceState(plain.get("last_s"), tuple(plain.get("seen_s", ())))


def _alarm(alarm: Alarm) -> dict[str, Any]:
    """With the delay that is running, which the event log leaves out."""
    return {name: value for name, value in asdict(alarm).items() if value is not None}
