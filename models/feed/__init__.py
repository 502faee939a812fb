"""What a feed does: how fast it moves, how much of the belt is covered."""

from lumpwatch.models.feed.flow import Displacement, TileFlow

__all__ = ["Displacement", "TileFlow"]
