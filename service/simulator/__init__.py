"""The simulated crusher: a feed with truth, deterministic."""

from lumpwatch.service.simulator.bodies import View, body, draw_body, turned
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.shape import pyramid
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video

__all__ = [
    "FeedSimulator",
    "FeedSpec",
    "View",
    "body",
    "draw_body",
    "pyramid",
    "turned",
    "write_video",
]
