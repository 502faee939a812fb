"""One target of the IMM particle filter tracker: its belief, its state, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.state import VX, VY, H, W, X, Y
from lumpwatch.models.trackers.imm_pf.filter import ImmBelief
from lumpwatch.models.trackers.imm_pf.identity import Looks
from lumpwatch.models.trackers.imm_pf.observation import Reference
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]


@dataclass(slots=True, eq=False, kw_only=True)
class Target:
    """Its identity, where it is, and for how long it has been how."""

    id: int
    belief: ImmBelief
    reference: Reference
    state: Array
    """Mean of the particles (8,)."""
    spread: Array
    usual: float
    """Appearance cost that it has when it is seen."""
    log_odds: float
    confirmed: bool = False
    age_s: float = 0.0
    weak_s: float = 0.0
    hidden_s: float = 0.0
    twin_s: float = 0.0
    lost_s: float = 0.0
    visible: float = 1.0
    looks: Looks = field(default_factory=Looks)


def described(target: Target) -> TrackedObject:
    """As users see it."""
    return TrackedObject(
        id=target.id,
        box=target.state[[X, Y, W, H]],
        velocity=target.state[[VX, VY]],
        spread=target.spread[[X, Y]],
        existence=1.0 / (1.0 + exp(-target.log_odds)),
        confirmed=target.confirmed,
        model_shares=target.belief.shares.copy(),
    )


def exchange(a: Target, b: Target) -> None:
    """Each goes on where the other is; what it looks like, and its identity, stay."""
    for name in ("belief", "state", "spread", "weak_s", "hidden_s", "visible"):
        here, there = getattr(a, name), getattr(b, name)
        setattr(a, name, there)
        setattr(b, name, here)
    for name in ("since", "since_s"):
        here, there = getattr(a.looks, name), getattr(b.looks, name)
        setattr(a.looks, name, there)
        setattr(b.looks, name, here)


def overlap(a: Array, b: Array) -> float:
    """Intersection over union of the boxes of two states."""
    w = min(a[X] + a[W] / 2, b[X] + b[W] / 2) - max(a[X] - a[W] / 2, b[X] - b[W] / 2)
    h = min(a[Y] + a[H] / 2, b[Y] + b[H] / 2) - max(a[Y] - a[H] / 2, b[Y] - b[H] / 2)
    if w <= 0.0 or h <= 0.0:
        return 0.0
    return float(w * h / (a[W] * a[H] + b[W] * b[H] - w * h))
