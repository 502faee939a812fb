"""Numbers of the tracker; lengths are relative to the target's box, times are seconds."""

from __future__ import annotations

from dataclasses import dataclass, field

from lumpwatch.models.trackers.imm_pf.filter import ImmOptions
from lumpwatch.models.trackers.imm_pf.observation import ObservationOptions


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """The defaults were chosen on the first half of PETS 2009 S2.L1, view 1."""

    filter: ImmOptions = field(default_factory=ImmOptions)
    observation: ObservationOptions = field(default_factory=ObservationOptions)

    absent_appearance: float = 4.6
    """Appearance cost of a box that holds no target; a silhouette that says nothing is added (see `absent_cost`)."""
    usual_appearance: float = 2.0
    """Appearance cost that a newborn target is expected to have."""
    usual_s: float = 3.0
    """Time over which that expectation follows the target."""
    independent_s: float = 0.14
    """Pictures closer than this count for less: they show the same."""
    most_evidence: float = 1.5
    """Log likelihood ratio of one picture is kept within plus and minus this."""
    most_log_odds: float = 7.0
    """Log odds of existence are kept within plus and minus this."""
    birth_log_odds: float = -1.0
    confirm_log_odds: float = 2.0
    """From here on the tracker stands by a target."""
    drop_log_odds: float = -3.0
    """Below it a target that was never confirmed is dropped."""
    weak_s: float = 3.0
    """A target whose mean likelihood stays under that of an absent one for longer ends."""
    hidden_below: float = 0.35
    """Visible share of a box below which it counts as hidden by nearer ones."""
    hidden_s: float = 4.0
    """A target that stays hidden for longer ends."""
    edge: float = 0.05
    """Share of the box beyond the picture's edge at which a target has left."""
    lost_s: float = 10.0
    """How long a target that ended is remembered, to be known again."""
    lost_distance: float = 0.6
    """Sum of the two colour distances (0 to 2) up to which a target is known again."""
    lost_reach: float = 1.0
    """It is looked for within this many heights a second of absence, and half a height more."""
    twin_overlap: float = 0.6
    """Intersection over union from which two targets may be one."""
    twin_s: float = 1.0
    """The younger of two targets that overlap for longer ends."""

    touching: float = 0.1
    """Two targets meet where their boxes share more than this part of the smaller one."""
    clear_above: float = 0.9
    """Visible share of a box from which it shows what its target looks like."""
    look_s: float = 5.0
    """Time over which the memory of a target's look fades."""
    settled_s: float = 1.0
    """How long two that met stand clear before they are told apart; 0: never."""
    exchange_margin: float = 0.15
    """They change places where that fits better by this, of sums of four colour distances (each 0 to 1)."""

    cover: float = 0.9
    """Part of the width and height of a box that hides what is behind it."""
    explained: float = 1.3
    """Foreground within a target's box, enlarged by this, bears no other target."""
    birth_height: float = 0.6
    birth_width: float = 0.4
    """Least size of a region that bears a target, in boxes at its row."""
    birth_fill: float = 0.3
    """Least share of foreground in a newborn target's box."""
    split_width: float = 1.6
    """A region wider than this many boxes bears several targets side by side."""
    birth_spread: float = 0.04
    """Standard deviation of a newborn target's position, in heights."""
    birth_speed: float = 0.5
    """Standard deviation of its velocity along x, in heights a second; a third of it along y."""

    def __post_init__(self) -> None:
        """Raises ValueError for numbers that cannot be meant."""
        for name in ("usual_s", "independent_s", "most_evidence", "most_log_odds", "cover", "split_width"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        if not self.drop_log_odds < self.birth_log_odds < self.confirm_log_odds < self.most_log_odds:
            raise ValueError("log odds must rise from drop over birth and confirm to the most")

    @property
    def absent_cost(self) -> float:
        """Minus the log likelihood of a box that holds no target."""
        seen = self.observation
        return self.absent_appearance + seen.silhouette * (1.0 - seen.neutral)
