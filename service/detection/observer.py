"""Observers of the steps of a camera's regions: counts and times, for metrics."""

from __future__ import annotations

from typing import Protocol


class ChannelListener(Protocol):
    """Observes the steps of a region."""

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """A stage (cut, quality, feed, filter) of the work on one frame took this long."""


class PipelineObserver(ChannelListener, Protocol):
    """Counts and times what happens in the pipeline; implemented by metrics."""

    def dropped(self, reason: str) -> None:
        """A frame was not processed."""

    def paced(self, roi: str) -> None:
        """A frame was not decided on by rule: the region was not due."""

    def prior_refused(self, roi: str, reason: str) -> None:
        """A prior cannot be used."""


class Unobserved:
    """An observer that ignores everything."""

    def dropped(self, reason: str) -> None:
        """Nothing."""

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """Nothing."""

    def paced(self, roi: str) -> None:
        """Nothing."""

    def prior_refused(self, roi: str, reason: str) -> None:
        """Nothing."""
