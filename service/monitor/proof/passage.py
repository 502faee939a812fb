"""What the test chain decides while the synthetic lump passes, and how that ends."""

from __future__ import annotations

from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import Change, Frame, RoiResult
from lumpwatch.service.monitor.proof.path import Way
from lumpwatch.service.protocol import LumpAt, Outcome, ProofReason, place_at


class Ended(Exception):  # noqa: N818 - an end is no error
    """The test is over before the lump is."""

    def __init__(self, outcome: Outcome, reason: ProofReason) -> None:
        super().__init__(reason.value)
        self.outcome = outcome
        self.reason = reason


class Passage:
    """What the test chain has decided while the lump passed."""

    def __init__(self, roi: RoiConfig) -> None:
        self._least_s = roi.proof_test.least_warning_s
        self.outcome = Outcome.FAILED
        self.reason: ProofReason | None = ProofReason.NOT_DETECTED
        self.warning_s: float | None = None
        self.existence = 0.0
        self.seen_s = 0.0

    def take(
        self, result: RoiResult, frame: Frame, way: Way, t_s: float, size: tuple[int, int], now_s: float
    ) -> None:
        """A frame was judged at `now_s`; the lump is `t_s` on its way. Raises Ended."""
        place = place_at(way.path, t_s)
        if place is not None:
            self.existence = max(self.existence, result.existence)
        transition = result.transition
        if self.warning_s is not None or transition is None or transition.change is not Change.RAISED:
            return
        if place is None or not overlaps(result, place, size):
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.DISTURBED)
        self.warning_s = way.arrives_s - t_s - (now_s - frame.capture_s)
        passed = self.warning_s >= self._least_s and self.warning_s > 0.0
        self.outcome = Outcome.PASSED if passed else Outcome.FAILED
        self.reason = None if passed else ProofReason.TOO_LATE


def overlaps(result: RoiResult, place: LumpAt, size: tuple[int, int]) -> bool:
    """Whether an object of the result lies on the lump, in pictures of `size`."""
    x, y, w, h = place.x * size[0], place.y * size[1], place.w * size[0], place.h * size[1]
    found = result.detection.counted if result.detection is not None else ()
    return any(
        abs(detected.x + detected.w / 2 - x) < (w + detected.w) / 2
        and abs(detected.y + detected.h / 2 - y) < (h + detected.h) / 2
        for detected in found
    )
