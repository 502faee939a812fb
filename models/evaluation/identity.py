"""The identity score: how much of the truth is followed by one and the same track.

    IDF1 = IDTP / ((true boxes + boxes of the result) / 2)

IDTP is the number of boxes that overlap by the threshold or more in paired tracks, under the one-to-one
assignment of tracks over the whole sequence that maximises it.

Source: Ristani et al., Performance measures and a data set for multi-target, multi-camera tracking,
ECCV workshops 2016.
"""

from __future__ import annotations

from lumpwatch.models.evaluation.pairing import Pairing, assign, ratio, track_overlaps


def idf1(pairing: Pairing, threshold: float) -> float:
    """Share of boxes with the right identity, 0 to 1; NaN where neither has a box."""
    shared, _ = track_overlaps(pairing, threshold)
    pairs = assign(shared, shared > 0.0)
    return ratio(float(shared[pairs].sum()), 0.5 * (pairing.truth_boxes + pairing.result_boxes))
