"""A fitted likelihood as arrays of a prior file, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_SHARE, HistogramFit, LumpFit
from lumpwatch.models.likelihood.histogram import BINS, Channel
from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns

Arrays = dict[str, NDArray[Any]]

_OLD_FEATURES = (8, 68)
"""Of likelihoods before the net."""


class OutdatedError(ValueError):
    """A fit of an older version; the text says what to do."""


def encode_fit(fit: LumpFit | HistogramFit) -> Arrays:
    """The arrays by name."""
    if isinstance(fit, HistogramFit):
        return {
            "fit_reference": fit.reference,
            "fit_line": np.array([fit.offset, fit.slope]),
            "fit_share": np.array([fit.evidence]),
        }
    arrays = {
        "fit_looks": np.array([fit.looks_per_s]),
        "fit_margin": np.array([fit.margin]),
        "fit_mean": fit.mean,
        "fit_scale": fit.scale,
        "fit_weights": fit.weights,
        "fit_line": np.array([fit.offset]),
    }
    if fit.net:
        arrays["fit_net"] = np.frombuffer(fit.net.encode(), np.uint8)
    if len(fit.patterns.offsets):
        arrays |= {"fit_directions": fit.patterns.directions, "fit_offsets": fit.patterns.offsets}
    return arrays


def decode_fit(arrays: Arrays, *, lump: bool, channel: Channel) -> LumpFit | HistogramFit:
    """The fit of a lump's likelihood, or of a histogram's. Raises KeyError or ValueError where it cannot be right."""
    if lump:
        return known_lump(arrays)
    _check(arrays, {"fit_reference": (BINS,), "fit_line": (2,)})
    offset, slope = arrays["fit_line"]
    return HistogramFit(arrays["fit_reference"], float(offset), float(slope), channel, _share(arrays))


def _check(arrays: Arrays, shapes: dict[str, tuple[int, ...]]) -> None:
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise ValueError(f"{key} has shape {arrays[key].shape}")


def known_lump(arrays: Arrays) -> LumpFit:
    """A lump's likelihood. Raises OutdatedError for one of hand-made features, KeyError or ValueError if it is none."""
    mean = arrays["fit_mean"]
    known = len(FEATURES)
    if len(mean) in _OLD_FEATURES:
        raise OutdatedError("was trained by a version without a net: train again")
    patterns = no_patterns(known)
    if "fit_directions" in arrays:
        patterns = Patterns(arrays["fit_directions"], arrays["fit_offsets"])
    count = len(patterns.offsets)
    shapes: dict[str, tuple[int, ...]] = {
        "fit_mean": (known,), "fit_scale": (known,), "fit_weights": (2 * known + count,), "fit_line": (1,),
    }  # fmt: skip
    if count:
        shapes |= {"fit_directions": (count, known), "fit_offsets": (count,)}
    _check(arrays, shapes)
    return LumpFit(
        mean=mean,
        scale=arrays["fit_scale"],
        weights=arrays["fit_weights"],
        offset=float(arrays["fit_line"][0]),
        looks_per_s=_looks(arrays),
        patterns=patterns,
        margin=_margin(arrays),
        net=bytes(arrays["fit_net"].astype(np.uint8)).decode("ascii") if "fit_net" in arrays else "",
    )


def _looks(arrays: Arrays) -> float:
    if "fit_looks" not in arrays:
        return DEFAULT_LOOKS_PER_S
    (looks,) = arrays["fit_looks"]
    if not 0.0 < looks < np.inf:
        raise ValueError(f"{looks} looks a second")
    return float(looks)


def _share(arrays: Arrays) -> float:
    if "fit_share" not in arrays:
        return DEFAULT_SHARE
    (share,) = arrays["fit_share"]
    if not 0.0 < share < np.inf:
        raise ValueError(f"a share of {share}")
    return float(share)


def _margin(arrays: Arrays) -> float:
    """None in a prior from before there was one: what it knows of lumps has less to spare."""
    if "fit_margin" not in arrays:
        return 0.0
    (margin,) = arrays["fit_margin"]
    if not np.isfinite(margin):
        raise ValueError(f"a margin of {margin}")
    return float(margin)
