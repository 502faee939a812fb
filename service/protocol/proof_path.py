"""Where the synthetic lump is at a moment of its way."""

from __future__ import annotations

import numpy as np

from lumpwatch.service.protocol.proof import LumpAt


def place_at(path: tuple[LumpAt, ...], t_s: float) -> LumpAt | None:
    """Between two moments it is between two places; None before and after its way."""
    times = [place.t_s for place in path]
    if not times[0] <= t_s <= times[-1]:
        return None
    x, y, w, h = (float(np.interp(t_s, times, [getattr(place, name) for place in path])) for name in "xywh")
    return LumpAt(t_s=t_s, x=x, y=y, w=w, h=h)
