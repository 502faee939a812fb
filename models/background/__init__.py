"""A statistical background model: colour, gradient and colour co-occurrence for each pixel (paper 3)."""

from models.background.model import StatisticalBackground
from models.background.options import BackgroundOptions

__all__ = ["BackgroundOptions", "StatisticalBackground"]
