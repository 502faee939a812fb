"""The proof test of a region that watches a mouth: a lump comes in and stays, and the blocked alarm must say so."""

from __future__ import annotations

from lumpwatch.models.roi import Roi
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import AlarmClass, Change, Frame, RoiResult
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.monitor.proof.passage import Ended, Passage
from lumpwatch.service.monitor.proof.path import Way
from lumpwatch.service.protocol import LumpAt, Outcome, ProofReason

LATE_S = 3.0
"""The alarm may come so much later than its delay after the lump has come to rest."""
_FALLS_S = 1.0
_FILLS = 0.95
"""Share of the mouth's width and height that the lump takes."""
_LONGEST_S = 500.0


def way_into(roi: Roi, config: RoiConfig, size: tuple[int, int]) -> Way:
    """The way in a picture of `size` (w, h): from above into the middle of the mouth, where the lump stays.

    Raises LumpwatchError where the alarm's delay is longer than a test may last.
    """
    delay_s = config.alarm.blocked.on_delay_s
    if delay_s > _LONGEST_S:
        raise LumpwatchError(
            f"alarm.blocked.on_delay_s ({delay_s:g}) is longer than a proof test may last, {_LONGEST_S:g} s"
        )
    (left, top), (right, bottom) = roi.corners.min(axis=0), roi.corners.max(axis=0)
    x, y = 0.5 * (left + right) / size[0], 0.5 * (top + bottom) / size[1]
    w, h = min(_FILLS * (right - left) / size[0], 1.0), min(_FILLS * (bottom - top) / size[1], 1.0)
    begins_s = config.proof_test.settle_s
    rests_s = begins_s + _FALLS_S
    arrives_s = rests_s + delay_s + LATE_S

    def at(t_s: float, row: float) -> LumpAt:
        return LumpAt(t_s=round(t_s, 3), x=x, y=max(row, -1.0), w=w, h=h)

    return Way((at(begins_s, y - h), at(rests_s, y), at(arrives_s, y)), arrives_s)


class MouthPassage(Passage):
    """What the test chain has decided while the lump stands in the mouth.

    `warning_s` is what was left of the time in which the alarm had to come.
    """

    def take(
        self, result: RoiResult, frame: Frame, way: Way, t_s: float, size: tuple[int, int], now_s: float
    ) -> None:
        """A frame was judged at `now_s`, `t_s` after the first. Raises Ended."""
        raised = any(
            change.alarm_class is AlarmClass.BLOCKED and change.transition.change is Change.RAISED
            for change in result.changes
        )
        if self.warning_s is not None or not raised:
            return
        if t_s < way.path[1].t_s:  # nothing of the test stood yet
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.DISTURBED)
        self.warning_s = way.arrives_s - t_s - (now_s - frame.capture_s)
        passed = self.warning_s > 0.0
        self.outcome = Outcome.PASSED if passed else Outcome.FAILED
        self.reason = None if passed else ProofReason.TOO_LATE
