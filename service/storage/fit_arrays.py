"""A fitted likelihood as arrays of a prior file, and back. The likelihoods are loaded with the first one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.storage.arrays import OutdatedError, within

if TYPE_CHECKING:
    from lumpwatch.models.learning.learned import HistogramFit, LumpFit
    from lumpwatch.models.likelihood.histogram import Channel

Arrays = dict[str, NDArray[Any]]

_OLD_FEATURES = (8, 20, 68)
"""How many measures earlier likelihoods took."""


def encode_fit(fit: LumpFit | HistogramFit) -> Arrays:
    """The arrays by name."""
    from lumpwatch.models.learning.learned import HistogramFit

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
    from lumpwatch.models.learning.learned import HistogramFit
    from lumpwatch.models.likelihood.histogram import BINS

    if lump:
        return known_lump(arrays)
    _check(arrays, {"fit_reference": (BINS,), "fit_line": (2,)})
    within("fit_reference", arrays["fit_reference"], 0.0, 1e9)
    within("fit_line", arrays["fit_line"], -1e4, 1e4)
    offset, slope = arrays["fit_line"]
    return HistogramFit(arrays["fit_reference"], float(offset), float(slope), channel, _share(arrays))


def _check(arrays: Arrays, shapes: dict[str, tuple[int, ...]]) -> None:
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise ValueError(f"{key} has shape {arrays[key].shape}")


_BOUNDS: dict[str, tuple[float, float]] = {
    "fit_mean": (-1e6, 1e6),
    "fit_scale": (1e-9, 1e6),
    "fit_weights": (-100.0, 100.0),
    "fit_line": (-100.0, 100.0),
    "fit_directions": (-1e3, 1e3),
    "fit_offsets": (-1e3, 1e3),
}
"""A score is a logarithm of odds: a term of hundreds would decide by itself, whatever the picture shows."""


def known_lump(arrays: Arrays) -> LumpFit:
    """A lump's likelihood. Raises OutdatedError for one of an earlier version, KeyError or ValueError if it is none."""
    from lumpwatch.models.learning.learned import LumpFit
    from lumpwatch.models.likelihood.lump import FEATURES
    from lumpwatch.models.likelihood.patterns import Patterns, no_patterns

    mean = arrays["fit_mean"]
    known = len(FEATURES)
    if len(mean) in _OLD_FEATURES:
        raise OutdatedError("was trained by a version with other measures of a box: train again")
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
    for key, (low, high) in _BOUNDS.items():
        if key in arrays:
            within(key, arrays[key], low, high)
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
    from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S

    if "fit_looks" not in arrays:
        return DEFAULT_LOOKS_PER_S
    (looks,) = arrays["fit_looks"]
    within("looks a second", looks, 0.1, 1e3)
    return float(looks)


def _share(arrays: Arrays) -> float:
    from lumpwatch.models.learning.learned import DEFAULT_SHARE

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
    within("margin", margin, -20.0, 20.0)
    return float(margin)
