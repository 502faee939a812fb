"""The Markov chain of existence (paper 1, Eq. 5), continuous in time.

With birth rate b and death rate d (per second) the chain over a time step dt has

    P_b = b / (b + d) (1 - exp(-(b + d) dt))        P_d = d / (b + d) (1 - exp(-(b + d) dt))

which composes: two half steps equal one whole step.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import expm1


@dataclass(frozen=True, slots=True)
class ExistenceChain:
    """Rates of birth and death of the object."""

    birth_rate: float
    """Births per second in an empty scene."""
    death_rate: float
    """Deaths per second: the inverse of the mean life."""

    def __post_init__(self) -> None:
        """Raises ValueError for rates that are not positive and finite."""
        if not 0 < self.birth_rate < float("inf") or not 0 < self.death_rate < float("inf"):
            raise ValueError("birth_rate and death_rate must be positive and finite")

    def probabilities(self, dt: float) -> tuple[float, float]:
        """P_b and P_d over `dt` seconds."""
        total = self.birth_rate + self.death_rate
        mixed = -expm1(-total * dt)
        return self.birth_rate / total * mixed, self.death_rate / total * mixed
