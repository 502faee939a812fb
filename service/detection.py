"""What a detector says of one frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DetectedObject:
    """The estimate of one object; lengths in full-frame pixels."""

    id: int
    x: float
    y: float
    w: float
    h: float
    """Box by its top left corner."""
    spread_x: float
    spread_y: float
    """Standard deviation of the centre."""
    existence: float
    model: str
    """The most probable motion model."""
    model_shares: tuple[tuple[str, float], ...] = ()
    """Name and probability of each motion model."""
    wrong_way: bool = False
    """Whether it moves against the configured direction."""


@dataclass(frozen=True, slots=True)
class Detection:
    """What the filter says of one frame."""

    existence: float
    objects: tuple[DetectedObject, ...]
    effective_particles: float = 0.0
    """0 for a detector without particles."""
    fell_back_share: float = 0.0
    """Share of particles far from all training data (jdt only)."""
