"""What every detector takes and gives."""

from __future__ import annotations

from typing import Protocol

from models.learning.learned import Learned
from models.roi import Image, Roi
from models.state import Belief
from service.detection import Detection

LONGEST_STEP_S = 2.0
"""After a longer gap between frames the objects may be anywhere: the search starts anew."""
SHOWN_ABOVE = 0.5
"""Existence from which an object is told of."""


class Detector(Protocol):
    """The detector of one ROI with what changes from frame to frame."""

    @property
    def roi(self) -> Roi:
        """Its geometry."""

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        """One working picture (h, w), `dt` seconds after the last; colour (h, w, 3) where it asks for it."""

    def use(self, learned: Learned | None) -> None:
        """Take another prior. Raises PriorMismatchError, and is then as before."""

    def clouds(self) -> tuple[Belief, ...]:
        """All particle clouds after the last step, for overlays and plots."""
