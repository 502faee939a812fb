"""The prior that a region's channel uses, and what stands in for one that fails in use."""

from __future__ import annotations

import logging
from collections import deque

from lumpwatch.service.detection.channel import Channel
from lumpwatch.service.detection.observer import PipelineObserver
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

log = logging.getLogger(__name__)

_MOST_FAILURES, _FAILS_WITHIN_S = 5, 30.0
"""So many failures of a filter in that time are the prior's."""


class PriorInUse:
    """Of one region; `name` is that of the region for the log, CAMERA/ROI."""

    def __init__(self, name: str, channel: Channel, before: Prior | None, observer: PipelineObserver) -> None:
        """`before`: the prior before the one in use; None: the stated defaults."""
        self._name, self._channel, self._before, self._observer = name, channel, before, observer
        self._failures_s: deque[float] = deque()

    def use(self, prior: Prior | None) -> bool:
        """Whether the channel goes on with it (None: the stated defaults); what does not fit is refused."""
        before = self._channel.prior
        try:
            self._channel.use(prior)
        except LumpwatchError as error:
            self.refuse(error)
            return False
        self._before = before
        self._failures_s.clear()
        return True

    def refuse(self, error: LumpwatchError) -> None:
        """A prior does not fit."""
        log.error("%s: prior refused: %s", self._name, error)
        self._observer.prior_refused(self._channel.config.id, "unfit")

    def failed(self, time_s: float | None) -> bool:
        """The filter has failed; whether that was once too often, and another prior stands in."""
        if self._channel.prior is None or time_s is None:
            return False
        self._failures_s.append(time_s)
        while self._failures_s[0] < time_s - _FAILS_WITHIN_S:
            self._failures_s.popleft()
        if len(self._failures_s) < _MOST_FAILURES:
            return False
        self._give_way(self._channel.prior)
        return True

    def _give_way(self, prior: Prior) -> None:
        """The one before stands in for it, or the stated defaults.

        Where neither can be used (some likelihoods need a prior) it stays, and the filter goes on trying.
        """
        before = self._before
        others = [None] if before is None or before.version == prior.version else [before, None]
        in_its_place = "nothing can stand"
        for other in others:
            try:
                self._channel.use(other)
            except Exception:
                continue  # this one fails as well
            in_its_place = "the stated defaults" if other is None else f"version {other.version}"
            break
        log.error(
            "%s: prior refused: version %d fails in use; %s in its place",
            self._name,
            prior.version,
            in_its_place,
        )
        self._before = None
        self._failures_s.clear()
        self._observer.prior_refused(self._channel.config.id, "failed")
