"""Keeps the proof tests of one camera: starts them when due, remembers the results, derives the troubles.

<store>/proof/<camera>/<roi>.json     the last result that could be judged
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Clocks, Trouble
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.monitor.proof.schedule import is_due, is_overdue
from lumpwatch.service.protocol import Outcome, ProofResult
from lumpwatch.service.storage import replace_file
from lumpwatch.service.telemetry import ProofMetrics

log = logging.getLogger(__name__)

Run = Callable[[str, str, ProofResult | None], ProofResult]
"""Tests a ROI on behalf of an actor; told how its last judged test ended."""


class ProofError(LumpwatchError):
    """A proof test cannot be made now."""


@dataclass(slots=True)
class _Roi:
    """What is known of one ROI's tests; times on the monotonic clock."""

    judged: ProofResult | None = None
    judged_s: float | None = None
    tried_s: float | None = None
    conclusive: bool = True


class ProofKeeper:
    """All methods may be called from any thread."""

    def __init__(
        self,
        camera: CameraConfig,
        store: Path,
        run: Run,
        metrics: ProofMetrics,
        clocks: Callable[[], Clocks],
    ) -> None:
        """Reads the last results; never raises for what is wrong with them."""
        self._camera = camera
        self._folder = store / "proof" / camera.id
        self._run = run
        self._metrics = metrics
        self._clocks = clocks
        self._running = threading.Lock()
        self._began_s = clocks().monotonic_s
        self._rois = {roi.id: self._read(roi.id) for roi in camera.rois}

    def troubles(self, roi: str) -> dict[Trouble, bool]:
        """The troubles that the ROI's tests report to its system alarm."""
        state, now = self._rois[roi], self._clocks().monotonic_s
        failed = state.judged is not None and state.judged.outcome is Outcome.FAILED
        since = self._began_s if state.judged_s is None else state.judged_s
        config = self._camera.roi(roi).proof_test
        return {Trouble.PROOF_TEST: failed, Trouble.PROOF_OVERDUE: is_overdue(config, now - since)}

    def poll(self) -> None:
        """Start a test where one is due and none is running."""
        clocks = self._clocks()
        due = []
        for roi in self._camera.rois:
            state = self._rois[roi.id]
            ago = None if state.tried_s is None else clocks.monotonic_s - state.tried_s
            wall = datetime.fromtimestamp(clocks.wall_s, UTC)
            if is_due(roi.proof_test, wall, ago, conclusive=state.conclusive):
                due.append(roi.id)
        if due and not self._running.locked():
            threading.Thread(target=self._scheduled, args=(due[0],), name="proof test", daemon=True).start()

    def test(self, roi: str, actor: str) -> ProofResult:
        """Test one ROI. Raises ProofError while another test of the camera is running."""
        if not self._running.acquire(blocking=False):
            raise ProofError("another proof test of this camera is running")
        try:
            log.info("%s/%s: proof test begins", self._camera.id, roi)
            result = self._run(roi, actor, self._rois[roi].judged)
        finally:
            self._running.release()
        self._take(roi, result)
        return result

    def _scheduled(self, roi: str) -> None:
        try:
            self.test(roi, "")
        except LumpwatchError as error:  # the bus is closed, or a test by command came first
            log.info("%s/%s: no proof test: %s", self._camera.id, roi, error)

    def _take(self, roi: str, result: ProofResult) -> None:
        state, now = self._rois[roi], self._clocks().monotonic_s
        state.tried_s, state.conclusive = now, result.outcome is not Outcome.INCONCLUSIVE
        why = f" ({result.reason.value})" if result.reason else ""
        level = logging.ERROR if result.outcome is Outcome.FAILED else logging.INFO
        log.log(level, "%s/%s: proof test %s%s", self._camera.id, roi, result.outcome.value, why)
        self._metrics.ended(roi, result)
        if not state.conclusive:
            return
        state.judged, state.judged_s = result, now
        path = self._folder / f"{roi}.json"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, result.line())
        except OSError as error:
            log.error("%s: cannot be written (%s)", path, error.strerror)  # noqa: TRY400 - it says it all

    def _read(self, roi: str) -> _Roi:
        path = self._folder / f"{roi}.json"
        try:
            result = ProofResult.model_validate_json(path.read_bytes())
            tested_s = result.time.timestamp()
        except FileNotFoundError:
            return _Roi()
        except (OSError, ValueError, OverflowError) as error:  # a file may hold anything
            log.warning(
                "%s: cannot be read (%s); as if there had been no proof test", path, type(error).__name__
            )
            return _Roi()
        clocks = self._clocks()
        then_s = clocks.monotonic_s - max(0.0, clocks.wall_s - tested_s)
        self._metrics.judged(roi, result)
        return _Roi(result, then_s, then_s)
