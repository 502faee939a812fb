"""How much of a frame's evidence counts for a histogram, and how noisy its motion is: learned from the training clips.

A histogram of colours says the same of an object in every frame, or something new in each, as the noise of the camera
has it. The share of a frame's log likelihood ratio that counts is the one with the best logarithmic score of existence
over the labelled frames (a strictly proper rule). Before that, the noise of the motion models is
chosen: the one under which the filter expects the pictures best, by its log evidence with all of each frame. Noise too
small loses the object at each turn, noise too large spreads the particles over places where it is not. With a share of
each frame the evidence would be none of any law, and say little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning import HistogramFit, Learned
from lumpwatch.models.roi import Roi
from lumpwatch.service.config import DetectorConfig, HistogramConfig, JdtConfig, RoiConfig
from lumpwatch.service.detection import Detector, JdtDetector, make_detector
from lumpwatch.service.training.footage import Footage
from lumpwatch.service.training.watching import watch

SHARES = (0.25, 0.5, 0.7, 1.0, 1.5)
"""Shares of a frame's log likelihood ratio that are tried. More than 1 can be right: the line is fitted to boxes that
lie a little beside the object, and one that fits says more."""
NOISES_H_S = (0.015, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Velocity noise of the quietest model that is tried, ROI heights a second gathered in one second."""
HISTOGRAM_TRIALS = len(SHARES) + len(NOISES_H_S)
"""Candidates that are judged, at most."""


_SURE = 0.001
"""Existence is taken as no nearer to 0 and 1 than this, or one frame could decide the score."""


def log_score(existence: NDArray[np.float64], present: NDArray[np.bool_]) -> float:
    """Mean log probability given to what was so, over frames with and without an object weighing the same.

    Raises ValueError where one of them is missing.
    """
    if present.all() or not present.any():
        raise ValueError("frames with and frames without an object are needed")
    p = np.clip(existence, _SURE, 1.0 - _SURE)
    return float(np.log(p[present]).mean() + np.log(1.0 - p[~present]).mean())


def tune_histogram(
    roi: RoiConfig, footage: Footage, learned: Learned, advance: Callable[[int], None] = lambda _: None
) -> Learned:
    """What was learned with its share of evidence and its noise.

    As it was where the likelihood is no histogram, or all frames or none show an object; a share and noise
    that are configured stay. `advance` is told how many candidates have been judged.
    """
    config, fit = roi.detector, learned.likelihood
    if not isinstance(config, JdtConfig) or not isinstance(config.likelihood, HistogramConfig):
        return learned
    present = np.array([len(item.objects) > 0 for item in footage.views], dtype=np.bool_)
    if not isinstance(fit, HistogramFit) or present.all() or not present.any():
        return learned
    done = 0

    def judged(candidate: Learned) -> tuple[float, float]:
        nonlocal done
        existence, evidence = _run(roi, footage, candidate)
        done += 1
        advance(done)
        return log_score(existence, present), evidence

    def best_share(known: Learned) -> Learned:
        if config.likelihood.evidence is not None:
            return known
        tried = [_with_share(known, share) for share in SHARES]
        return max(tried, key=lambda one: judged(one)[0])

    tuned = learned
    if all(model.velocity_noise_h_s is None for model in config.models):
        noisy = [_with_noise(learned, level) for level in NOISES_H_S]
        tuned = max(noisy, key=lambda one: judged(_with_share(one, 1.0))[1])
    tuned = best_share(tuned)
    advance(HISTOGRAM_TRIALS)
    return tuned


def _with_share(learned: Learned, share: float) -> Learned:
    assert isinstance(learned.likelihood, HistogramFit)
    return replace(learned, likelihood=replace(learned.likelihood, evidence=share))


def _with_noise(learned: Learned, level: float) -> Learned:
    """The quietest model at a level; the others keep their proportion to it."""
    return replace(learned, velocity_noise=learned.velocity_noise * (level / learned.velocity_noise.min()))


def _run(roi: RoiConfig, footage: Footage, learned: Learned) -> tuple[NDArray[np.float64], float]:
    """Existence after each picture, and the log evidence of all of them."""
    made: list[JdtDetector] = []

    def make(config: DetectorConfig, geometry: Roi, known: Learned | None) -> Detector:
        detector = make_detector(config, geometry, known)
        assert isinstance(detector, JdtDetector)
        made.append(detector)
        return detector

    said = [channel.detection for _, channel in watch(roi, footage, learned, make=make)]
    existence = np.array([detection.existence for detection in said if detection is not None])
    return existence, sum(detector.log_evidence for detector in made)
