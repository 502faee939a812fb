"""Joint probabilistic data association: its marginals, and a tracker of boxes built on them (paper 3)."""

from models.jpda.association import Association, associate
from models.jpda.options import ColourOptions, JpdaOptions
from models.jpda.tracker import JpdaTracker
from models.jpda.zones import OneWay

__all__ = ["Association", "ColourOptions", "JpdaOptions", "JpdaTracker", "OneWay", "associate"]
