"""What a feed does: how fast it moves, how much of the belt is covered."""

from lumpwatch.models.feed.flow import Displacement, TileFlow
from lumpwatch.models.feed.load import CoverMeter
from lumpwatch.models.feed.motion import FeedMotion, Motion, Moves
from lumpwatch.models.feed.sizes import SizeTrend

__all__ = ["CoverMeter", "Displacement", "FeedMotion", "Motion", "Moves", "SizeTrend", "TileFlow"]
