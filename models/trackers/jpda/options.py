"""What a JPDA tracker can be told; lengths in pixels of its pictures, times in seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lumpwatch.models.jdt.motion import AffineModel, ConstantVelocity
from lumpwatch.models.trackers.jpda.association import LARGEST_EXACT
from lumpwatch.models.trackers.jpda.zones import OneWay, Polygon


@dataclass(frozen=True, slots=True)
class ColourOptions:
    """How colour takes part in the likelihood (Eq. 31-33); it needs a picture at each step."""

    weight: float = 0.3
    """Exponent of the colour ratio; 0: colour is not looked at."""
    kappa: float = 5.0
    """How fast the likelihood falls with the squared Bhattacharyya distance."""
    neutral: float = 0.7
    """The distance at which colour speaks neither for nor against a target."""
    bins: int = 8
    """Levels of each channel: 2, 4, 8 or 16."""

    def __post_init__(self) -> None:
        """Raises ValueError for a weight, distance or kappa out of range."""
        if not (0.0 <= self.weight <= 1.0 and self.kappa >= 0.0 and 0.0 <= self.neutral <= 1.0):
            raise ValueError("colour: weight and neutral must lie between 0 and 1, kappa not below 0")
        if self.bins not in (2, 4, 8, 16):
            raise ValueError(f"colour: bins must be 2, 4, 8 or 16, not {self.bins}")


@dataclass(frozen=True, slots=True)
class JpdaOptions:
    """Fixed parts of a tracker."""

    model: AffineModel = field(default_factory=lambda: ConstantVelocity("straight", 40.0))
    """Motion of a target; any model that states its law."""
    noise_px: float = 2.0
    """Standard deviation of a measured centre along each axis."""
    detection: float = 0.9
    """Probability that an existing target is detected in a picture."""
    clutter: float = 0.5
    """Expected number of false boxes in a picture."""
    gate_sigma: float = 4.0
    """Radius of the validation gate in standard deviations."""
    space_weight: float = 0.7
    """Exponent of the spatial likelihood ratio (Eq. 33)."""
    colour: ColourOptions = field(default_factory=ColourOptions)
    association: Literal["jpda_star", "jpda"] = "jpda_star"
    """JPDA* counts the most probable permutation alone, which keeps close targets apart; jpda sums over all events."""
    exact: int = 12
    """Smaller side of the largest cluster whose marginals are summed exactly; time doubles with each."""
    most: int = 64
    """Largest number of targets."""

    birth_apart: float = 0.75
    """A measurement nearer to a target starts no other (Eq. 30), in mean sides of the target's box."""
    birth_existence: float = 0.3
    """Probability that a measurement which nothing explains is an object."""
    birth_speed: float = 100.0
    """Standard deviation of a newborn target's velocity along each axis (px/s)."""
    birth_acceleration: float = 100.0
    """The same of its acceleration (px/s^2), where the model has one."""
    entries: Sequence[Polygon] = ()
    """Where targets start; empty: anywhere."""

    confirm_above: float = 0.95
    """Existence that a target needs to be confirmed."""
    confirm_s: float = 0.1
    """How long it must have been seen until then."""
    lifetime_s: float = 30.0
    """Mean time that a target stays."""
    missed_s: float = 0.3
    """A target that was missed for longer, and in two pictures at least, ends."""
    end_below: float = 0.05
    """A target of smaller existence ends."""
    shared_s: float = 1.0
    """A target that has lain on an older one for longer is the same object."""
    exits: Sequence[Polygon] = ()
    """Where a target ends when it is missed once; so does one that would leave the picture within `missed_s`."""

    size_s: float = 0.2
    """Time constant with which a target's box follows the measured sizes."""
    split: bool = True
    """Whether a region that holds several confirmed targets is cut into one box for each."""
    one_way: OneWay | None = None
    """The right direction, where there is one."""

    def __post_init__(self) -> None:
        """Raises ValueError where an option is out of range; it names the option."""
        for name in ("noise_px", "clutter", "gate_sigma", "birth_speed", "lifetime_s", "size_s"):
            _check(name, getattr(self, name), 0.0, np.inf, excluded=True)
        for name in ("birth_apart", "birth_acceleration", "confirm_s", "missed_s", "shared_s"):
            _check(name, getattr(self, name), 0.0, np.inf)
        for name in ("detection", "space_weight", "birth_existence"):
            _check(name, getattr(self, name), 0.0, 1.0, excluded=True)
        for name in ("confirm_above", "end_below"):
            _check(name, getattr(self, name), 0.0, 1.0)
        if not 0 <= self.exact <= LARGEST_EXACT:
            raise ValueError(f"exact must lie between 0 and {LARGEST_EXACT}, not {self.exact}")
        if self.association not in ("jpda_star", "jpda"):
            raise ValueError(f"association must be jpda_star or jpda, not {self.association!r}")
        if self.most < 1:
            raise ValueError(f"most must be at least 1, not {self.most}")
        if any(len(polygon) < 3 for polygon in (*self.entries, *self.exits)):
            raise ValueError("a zone needs three corners at least")


def _check(name: str, value: float, low: float, high: float, excluded: bool = False) -> None:
    if not low <= value <= high or (excluded and value == low) or value == np.inf:
        raise ValueError(f"{name} must lie between {low:g} and {high:g}, not {value}")
