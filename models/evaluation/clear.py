"""The CLEAR MOT metrics.

Frame by frame, true boxes and those of the result are paired one to one where they overlap by the
threshold or more. A correspondence that held before is kept while both boxes are there and still
overlap enough, even where another box fits better; what is left is paired by the largest sum of
overlaps. Over all frames, with G the number of true boxes:

    MOTA = 1 - (misses + false positives + identity switches) / G
    MOTP = sum of the overlaps of pairs / number of pairs

MOTP is taken in overlap, as in VACE, so that larger is better; the paper has it in distance.

Source: Bernardin, Stiefelhagen, Evaluating multiple object tracking performance: the CLEAR MOT
metrics, EURASIP J. Image and Video Processing, 2008, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumpwatch.models.evaluation.pairing import FramePair, Indices, Pairing, assign, ratio, reaches

_NONE = -1


@dataclass(frozen=True, slots=True)
class ClearMot:
    """What was counted."""

    matches: int
    """Pairs of boxes."""
    misses: int
    """True boxes without a partner."""
    false_positives: int
    """Boxes of the result without a partner."""
    id_switches: int
    """Pairs whose true track was last paired with another track of the result."""
    fragmentations: int
    """Times that a true track is paired again after frames in which it was there but missed."""
    overlap: float
    """Sum of the overlaps of the pairs."""

    @property
    def mota(self) -> float:
        """Tracking accuracy, at most 1; NaN without true boxes."""
        wrong = self.misses + self.false_positives + self.id_switches
        return 1.0 - ratio(wrong, self.matches + self.misses)

    @property
    def motp(self) -> float:
        """Mean overlap of the pairs, from the threshold to 1; NaN without pairs."""
        return ratio(self.overlap, self.matches)

    @property
    def precision(self) -> float:
        """Share of the result's boxes that have a partner; NaN without boxes of the result."""
        return ratio(self.matches, self.matches + self.false_positives)

    @property
    def recall(self) -> float:
        """Share of the true boxes that have a partner; NaN without true boxes."""
        return ratio(self.matches, self.matches + self.misses)


def clear_mot(pairing: Pairing, threshold: float, across_gaps: bool = True) -> ClearMot:
    """Pair frame by frame and count.

    A correspondence is remembered across frames in which it did not hold, as in the paper; without
    `across_gaps` it is kept from one frame to the next only, as the MOTChallenge tools do.
    """
    last = np.full(pairing.truth_tracks, _NONE, np.intp)  # partner of each true track, ever
    missed_since = np.zeros(pairing.truth_tracks, dtype=np.bool_)
    matches = misses = false_positives = switches = fragmentations = 0
    overlap = 0.0
    before = last.copy()
    for frame in pairing.frames:
        rows, columns = _correspondences(frame, last if across_gaps else before, threshold)
        true, found = frame.truth[rows], frame.result[columns]

        known = last[true] != _NONE
        switches += int(np.count_nonzero(known & (last[true] != found)))
        fragmentations += int(np.count_nonzero(known & missed_since[true]))
        matches += len(rows)
        misses += len(frame.truth) - len(rows)
        false_positives += len(frame.result) - len(rows)
        overlap += float(frame.overlap[rows, columns].sum())

        last[true] = found
        before[:] = _NONE
        before[true] = found
        missed_since[frame.truth] = True
        missed_since[true] = False
    return ClearMot(matches, misses, false_positives, switches, fragmentations, overlap)


def _correspondences(frame: FramePair, partner: Indices, threshold: float) -> tuple[Indices, Indices]:
    """As many remembered pairs as can be kept, then the largest sum of overlaps."""
    allowed = reaches(frame.overlap, threshold)
    kept = partner[frame.truth][:, None] == frame.result
    more_than_all_overlaps = 1.0 + min(frame.overlap.shape)
    return assign(frame.overlap + more_than_all_overlaps * kept, allowed)
