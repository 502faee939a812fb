"""What each tile of a region usually looks like, and how many look otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.picture.measures import PictureMeasures

Tiles = NDArray[np.float32]

_OUTER = 0.01  # share of the reference that lies below and above the usual
_MARGIN = 0.25  # logarithm by which the usual is widened: other days, other light
_LEAST_DETAIL = 0.003  # of the mean: below that a logarithm says nothing


@dataclass(frozen=True, slots=True)
class Pattern:
    """The usual range of level and detail of each tile (n,), as logarithms relative to the mean."""

    level_low: Tiles
    level_high: Tiles
    detail_low: Tiles
    detail_high: Tiles

    def strange(self, measures: PictureMeasures) -> float:
        """Share of the tiles that do not look as usual."""
        level, detail = _relative(measures)
        usual = (level >= self.level_low) & (level <= self.level_high)
        usual &= (detail >= self.detail_low) & (detail <= self.detail_high)
        return 1.0 - float(usual.mean())


def learn_pattern(pictures: Sequence[PictureMeasures]) -> Pattern:
    """The pattern of pictures that are fit; raises ValueError without any."""
    if not pictures:
        raise ValueError("there is no picture to learn from")
    levels, details = (np.stack(values) for values in zip(*map(_relative, pictures), strict=True))
    low = np.quantile([levels, details], _OUTER, axis=1) - _MARGIN
    high = np.quantile([levels, details], 1.0 - _OUTER, axis=1) + _MARGIN
    bounds = [np.asarray(bound, np.float32) for bound in (low[0], high[0], low[1], high[1])]
    return Pattern(*bounds)


def _relative(measures: PictureMeasures) -> tuple[Tiles, Tiles]:
    mean = max(measures.mean, 1.0)
    level = np.log(np.maximum(measures.level / mean, 0.02))
    detail = np.log(np.maximum(measures.detail / mean, _LEAST_DETAIL))
    return np.asarray(level, np.float32), np.asarray(detail, np.float32)
