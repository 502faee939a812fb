"""All metrics of a tracking result at once, with the sense of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lumpwatch.models.evaluation.clear import clear_mot
from lumpwatch.models.evaluation.identity import idf1
from lumpwatch.models.evaluation.pairing import pair
from lumpwatch.models.evaluation.tracks import Tracks
from lumpwatch.models.evaluation.vace import ata, n_moda, n_modp, sfda


@dataclass(frozen=True, slots=True)
class Scores:
    """How a tracking result compares with the truth; NaN where a score has nothing to divide by."""

    sfda: float
    """Sequence frame detection accuracy, 0 to 1; no threshold."""
    ata: float
    """Average tracking accuracy, original form, 0 to 1; no threshold."""
    ata_relaxed: float
    """Average tracking accuracy with overlaps counted as 0 or 1 at the threshold, 0 to 1."""
    n_modp: float
    """Normalised multiple object detection precision, 0 to 1; pairs at the threshold."""
    n_moda: float
    """Normalised multiple object detection accuracy, at most 1; pairs at the threshold."""
    motp: float
    """Multiple object tracking precision in overlap, from the threshold to 1."""
    mota: float
    """Multiple object tracking accuracy, at most 1; pairs at the threshold."""
    idf1: float
    """Share of boxes with the right identity, 0 to 1; pairs at the threshold."""
    precision: float
    """Share of the result's boxes that lie on a true one, 0 to 1; pairs at the threshold."""
    recall: float
    """Share of the true boxes that were found, 0 to 1; pairs at the threshold."""
    id_switches: int
    """Changes of the track that follows an object; smaller is better."""
    fragmentations: int
    """Interruptions of an object's tracking; smaller is better."""
    misses: int
    """True boxes without a partner; smaller is better."""
    false_positives: int
    """Boxes of the result without a partner; smaller is better."""
    matches: int
    """Pairs of boxes."""
    truth_boxes: int
    truth_tracks: int
    result_boxes: int
    result_tracks: int
    frames: int
    """Frames in which truth or result has a box."""
    threshold: float
    """Least overlap of a pair."""


@dataclass(frozen=True, slots=True)
class Metric:
    """How to read one score."""

    field: str
    """Attribute of `Scores`."""
    name: str
    better: Literal["larger", "smaller"]
    says: str


METRICS = (
    Metric("sfda", "SFDA", "larger", "boxes found, and how well they fit"),
    Metric("ata", "ATA", "larger", "whole tracks: length and fit"),
    Metric("ata_relaxed", "ATA relaxed", "larger", "whole tracks: length at the threshold"),
    Metric("n_modp", "N-MODP", "larger", "fit of the pairs, mean over frames"),
    Metric("motp", "MOTP", "larger", "fit of the pairs, mean over pairs"),
    Metric("n_moda", "N-MODA", "larger", "1 - (misses + false) / true boxes"),
    Metric("mota", "MOTA", "larger", "the same, switches are errors too"),
    Metric("idf1", "IDF1", "larger", "boxes with the right identity"),
    Metric("precision", "precision", "larger", "result boxes that lie on a true one"),
    Metric("recall", "recall", "larger", "true boxes that were found"),
    Metric("id_switches", "identity switches", "smaller", "another track took the object over"),
    Metric("fragmentations", "fragmentations", "smaller", "the object was lost and found again"),
    Metric("misses", "misses", "smaller", "true boxes without a partner"),
    Metric("false_positives", "false positives", "smaller", "result boxes without a partner"),
)
"""The scores that tell good from bad; the other fields of `Scores` are counts."""


def evaluate(result: Tracks, truth: Tracks, threshold: float = 0.5) -> Scores:
    """Compare a tracking result with the truth; `threshold` is the least overlap of a pair of boxes.

    Either may be empty. Raises ValueError where the threshold is not within 0 and 1.
    """
    if not 0.0 <= threshold <= 1.0:
        raise ValueError(f"the threshold must be within 0 and 1, not {threshold:g}")
    pairing = pair(result, truth)
    counted = clear_mot(pairing, threshold)
    return Scores(
        sfda=sfda(pairing),
        ata=ata(pairing),
        ata_relaxed=ata(pairing, threshold),
        n_modp=n_modp(pairing, threshold),
        n_moda=n_moda(pairing, threshold),
        motp=counted.motp,
        mota=counted.mota,
        idf1=idf1(pairing, threshold),
        precision=counted.precision,
        recall=counted.recall,
        id_switches=counted.id_switches,
        fragmentations=counted.fragmentations,
        misses=counted.misses,
        false_positives=counted.false_positives,
        matches=counted.matches,
        truth_boxes=pairing.truth_boxes,
        truth_tracks=pairing.truth_tracks,
        result_boxes=pairing.result_boxes,
        result_tracks=pairing.result_tracks,
        frames=len(pairing.frames),
        threshold=threshold,
    )
