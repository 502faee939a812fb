"""What stands in a crusher's mouth or a chute, from its pictures alone."""

from lumpwatch.models.mouth.blockage import Arrival, Limits, MouthState, MouthWatch
from lumpwatch.models.mouth.patches import PatchGrid
from lumpwatch.models.mouth.standing import Standing

__all__ = ["Arrival", "Limits", "MouthState", "MouthWatch", "PatchGrid", "Standing"]
