"""Detection and tracking accuracy of the VACE programme.

In frame t the truth has N_G(t) boxes and the result N_D(t); o_i are the overlaps of the pairs of a
one-to-one assignment.

    FDA(t)  = Σ_i o_i / ((N_G(t) + N_D(t)) / 2)             SFDA   = mean of FDA(t)
    MODP(t) = Σ_i o_i / number of pairs, 0 without a pair     N-MODP = mean of MODP(t)
                           N-MODA = 1 - Σ_t (misses + false positives) / Σ_t N_G(t)

Means run over the frames in which truth or result has a box. SFDA knows no threshold: its assignment
maximises Σ_i o_i over all pairs. MODP and MODA pair only boxes that overlap by the threshold or more.

    STDA = Σ over pairs of tracks (G_i, D_i) of Σ_t o_i(t) / (number of frames with G_i or D_i)
    ATA  = STDA / ((number of true tracks + number of the result's tracks) / 2)

with the one-to-one assignment of tracks that maximises STDA. The original form sums the overlap o_i(t)
itself; the relaxed form counts 1 where o_i(t) reaches the threshold and 0 elsewhere.

Sources: Kasturi et al., Framework for performance evaluation of face, text, and vehicle detection and
tracking in video, PAMI 31(2), 2009; relaxed form: Manohar et al., Performance evaluation of object
detection and tracking in video, ACCV 2006.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lumpwatch.models.evaluation.pairing import (
    Array,
    FramePair,
    Pairing,
    assign,
    ratio,
    reaches,
    track_overlaps,
)


def sfda(pairing: Pairing) -> float:
    """Sequence frame detection accuracy, 0 to 1; NaN where neither has a box."""
    total = 0.0
    for frame in pairing.frames:
        pairs = assign(frame.overlap, np.ones(frame.overlap.shape, np.bool_))
        total += float(frame.overlap[pairs].sum()) / (0.5 * (len(frame.truth) + len(frame.result)))
    return ratio(total, len(pairing.frames))


def ata(pairing: Pairing, threshold: float | None = None) -> float:
    """Average tracking accuracy, 0 to 1; NaN where neither has a track.

    The original form without `threshold`, the relaxed form with it.
    """
    shared, present = track_overlaps(pairing, threshold)
    accuracy = shared / present
    pairs = assign(accuracy, accuracy > 0.0)
    return ratio(float(accuracy[pairs].sum()), 0.5 * (pairing.truth_tracks + pairing.result_tracks))


def n_modp(pairing: Pairing, threshold: float) -> float:
    """Normalised multiple object detection precision, 0 to 1; NaN where neither has a box."""
    precision = sum(float(pairs.mean()) for _, pairs in _mapped(pairing, threshold) if len(pairs))
    return ratio(precision, len(pairing.frames))


def n_moda(pairing: Pairing, threshold: float) -> float:
    """Normalised multiple object detection accuracy, at most 1; NaN without true boxes."""
    errors = sum(
        len(frame.truth) + len(frame.result) - 2 * len(pairs) for frame, pairs in _mapped(pairing, threshold)
    )
    return 1.0 - ratio(errors, pairing.truth_boxes)


def _mapped(pairing: Pairing, threshold: float) -> Iterator[tuple[FramePair, Array]]:
    """Each frame with the overlaps of its pairs."""
    for frame in pairing.frames:
        yield frame, frame.overlap[assign(frame.overlap, reaches(frame.overlap, threshold))]
