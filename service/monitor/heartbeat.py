"""The dead man's switch: a heartbeat that states by itself when it must not be trusted.

It is sent by the monitor's main loop, so it stops when that hangs. A loop that turns without deciding
makes it invalid: a CLEAR or a LUMP counts for `blind_after_s` after the decision that it came from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lumpwatch.service.core import Clocks, Decision, utc
from lumpwatch.service.protocol import VALID_S, Heartbeat, RoiBeat


@dataclass(frozen=True, slots=True)
class LastDecision:
    """What is known of a ROI when a heartbeat is due."""

    state: Decision
    decided_s: float | None
    """Monotonic time of its last decision on a frame."""


def roi_beat(last: LastDecision, blind_after_s: float, clocks: Clocks) -> RoiBeat:
    """The part of one ROI in the heartbeat at the moment `clocks`."""
    if last.decided_s is None:
        return RoiBeat(state=last.state, decided_ago_s=None, valid=last.state is Decision.BLIND)
    ago = max(0.0, clocks.monotonic_s - last.decided_s)
    return RoiBeat(
        state=last.state,
        decided_ago_s=round(ago, 3),
        decided=utc(clocks.wall_s - ago),
        valid=last.state is Decision.BLIND or ago <= blind_after_s,
    )


def heartbeat(
    site: str,
    camera: str,
    seq: int,
    rois: Mapping[str, LastDecision],
    blind_after_s: float,
    clocks: Clocks,
) -> Heartbeat:
    """The heartbeat of a camera's monitor; one of no ROI is not valid."""
    beats = {roi: roi_beat(last, blind_after_s, clocks) for roi, last in rois.items()}
    return Heartbeat(
        site=site,
        camera=camera,
        seq=seq,
        time=utc(clocks.wall_s),
        valid_s=VALID_S,
        valid=bool(beats) and all(beat.valid for beat in beats.values()),
        rois=beats,
    )
