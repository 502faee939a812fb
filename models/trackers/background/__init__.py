"""A statistical background model: colour, gradient and colour co-occurrence for each pixel (paper 3)."""

from lumpwatch.models.trackers.background.model import StatisticalBackground
from lumpwatch.models.trackers.background.options import BackgroundOptions

__all__ = ["BackgroundOptions", "StatisticalBackground"]
