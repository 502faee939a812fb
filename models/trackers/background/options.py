"""What can be set about the background model, and what is refused.

Paper 3 and OpenCV's CUDA version of the model leave some of these open or differ in them: 256 levels and
32 against 128 and 64, tables of 15 of 25 and 25 of 40 entries. The defaults here were chosen by F1 on
generated scenes; tables of 10 of 15 and 15 of 25 find as much as the larger ones in 0.6 of the memory.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Literal


@dataclass(frozen=True, slots=True)
class BackgroundOptions:
    """Parameters of `StatisticalBackground`; the names in brackets are those of the papers."""

    static_levels: int = 256
    """Levels of a colour or gradient component: a power of two, 8 to 256."""
    static_used: int = 10
    """Entries of a colour or gradient table that are looked at [N1]."""
    static_kept: int = 15
    """Entries that are kept [N2]."""
    static_distance: float = 0.005
    """Colours or gradients closer than this are the same (Eq. 8) [delta]."""
    noise_floor: float = 6.0
    """Grey levels a component by which they may differ besides; 0 is Eq. 8 alone."""
    dynamic_levels: int = 32
    """Levels of a component of a co-occurrence: a power of two, 8 to 256."""
    dynamic_used: int = 15
    """Entries of a co-occurrence table that are looked at [N1]."""
    dynamic_kept: int = 25
    """Entries that are kept [N2]."""
    dynamic_distance: int = 2
    """Levels by which components of the same co-occurrence may differ (Eq. 9) [delta]."""
    learning_rate: float = 0.005
    """Weight of one frame in the tables (Eq. 10) [alpha, alpha 2]."""
    initial_rate: float = 0.1
    """The same in the first frames [alpha 3]."""
    initial_frames: int = 30
    """Frames at the start in which everything is taken for background."""
    learn_every: int = 6
    """A pixel that is background learns in every so many frames, row by row, for all of them at once; 1: in each.
    After a change of light it is 1 until the background picture has followed."""
    background_rate: float = 0.1
    """Weight of one frame in the background picture (Eq. 17) [beta, alpha 1]."""
    once_off_share: float = 0.8
    """Share of the foreground above which it turns into background (Eq. 13) [M, T]."""
    once_off: Literal["keep", "swap"] = "keep"
    """Whether the old background stays known then, or turns into foreground as in Eq. 14."""
    rule: Literal["either", "paper"] = "either"
    """Whether a pixel that moved is foreground only if the background picture, colour and gradient, and
    co-occurrence all disown it, or by co-occurrence alone as in the papers."""
    change_sigmas: float = 4.5
    """Standard deviations of the difference at which a pixel has changed."""
    least_change: float = 10.0
    """Grey levels below which the automatic threshold never falls."""
    largest_change: float = 40.0
    """Grey levels above which it never rises."""
    largest_light: float = 60.0
    """Grey levels by which most of the picture may change at once and be taken for light; 0 for never.
    Something plain that covers more than half of the picture looks the same."""
    darkest_shadow: float = 0.4
    """Share of the light that a shadow leaves at least; 1: shadows are foreground. A dark object of the ground's own
    hue looks the same. Pictures without colour are not asked."""
    shadow_noise: float = 5.0
    """Grey levels by which the colour of a shadow may differ from that of the place, root mean square."""
    least_area: int = 15
    """Pixels of the smallest connected region that is kept; 1 keeps all."""
    threads: int = 1
    """Threads of the kernel, at most as many as numba has. With 1 no thread pool is ever started."""

    def __post_init__(self) -> None:
        """Raises ValueError with the name of what is out of range."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not isfinite(value):
                raise ValueError(f"{field.name} must be finite, not {value}")
        for name in ("static_levels", "dynamic_levels"):
            if getattr(self, name) not in (8, 16, 32, 64, 128, 256):
                raise ValueError(f"{name} must be a power of two from 8 to 256, not {getattr(self, name)}")
        for kind in ("static", "dynamic"):
            used, kept = getattr(self, f"{kind}_used"), getattr(self, f"{kind}_kept")
            if not 1 <= used < kept <= 255:
                raise ValueError(f"1 <= {kind}_used < {kind}_kept <= 255 does not hold for {used} and {kept}")
        for name in ("learning_rate", "initial_rate"):
            if not 0.0 < getattr(self, name) <= 0.5:
                raise ValueError(f"{name} must be above 0 and at most 0.5, not {getattr(self, name):g}")
        if not 0.0 < self.background_rate <= 1.0:
            raise ValueError(f"background_rate must be above 0 and at most 1, not {self.background_rate:g}")
        if not 0.5 < self.once_off_share < 1.0:
            raise ValueError(f"once_off_share must lie between 0.5 and 1, not {self.once_off_share:g}")
        if not 0.0 < self.darkest_shadow <= 1.0:
            raise ValueError(f"darkest_shadow must be above 0 and at most 1, not {self.darkest_shadow:g}")
        if self.once_off not in ("keep", "swap"):
            raise ValueError(f"once_off must be keep or swap, not {self.once_off!r}")
        if self.rule not in ("either", "paper"):
            raise ValueError(f"rule must be either or paper, not {self.rule!r}")
        for name in (
            "static_distance", "noise_floor", "dynamic_distance", "initial_frames", "change_sigmas", "largest_light",
            "shadow_noise",
        ):  # fmt: skip
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, not {getattr(self, name):g}")
        if not 0.0 <= self.least_change <= self.largest_change:
            raise ValueError("0 <= least_change <= largest_change does not hold")
        for name in ("least_area", "threads", "learn_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, not {getattr(self, name)}")
