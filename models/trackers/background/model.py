"""The statistical background model of Li et al. as paper 3 uses it: picture in, foreground mask out.

Each frame: limits of change (`change`), every pixel judged and learned (`kernel`), shadows (`shadow`) and small
regions removed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.background.change import change_limits, count_differences
from lumpwatch.models.trackers.background.kernel import process, process_parallel
from lumpwatch.models.trackers.background.options import BackgroundOptions
from lumpwatch.models.trackers.background.regions import keep_large
from lumpwatch.models.trackers.background.settings import settings_of
from lumpwatch.models.trackers.background.shadow import is_grey, remove_shadows
from lumpwatch.models.trackers.background.tables import Tables, blank_tables, from_arrays, to_arrays

Picture = NDArray[np.uint8]
Mask = NDArray[np.uint8]
_SETTLED = 2.0
"""Grey levels between picture and background picture, in the middle, from which the light has changed."""
_KEPT_BY_STATE = ("static_levels", "static_kept", "dynamic_levels", "dynamic_kept")
"""Options that shape the tables."""


class StatisticalBackground:
    """Learns what a still camera sees, and says of every picture what does not belong to that.

    The first picture sets the size. Not for use by two threads at once.
    """

    def __init__(self, options: BackgroundOptions | None = None) -> None:
        self._options = options or BackgroundOptions()
        self._tables: Tables | None = None

    @property
    def options(self) -> BackgroundOptions:
        """The parameters in force."""
        return self._options

    @property
    def frames(self) -> int:
        """Frames learned from."""
        return 0 if self._tables is None else self._tables.frames

    @property
    def nbytes(self) -> int:
        """Memory of what was learned in bytes; 0 before the first picture."""
        return 0 if self._tables is None else sum(array.nbytes for array in self._tables.arrays.values())

    def apply(self, picture: Picture, learn: bool = True, mask: Mask | None = None) -> Mask:
        """The foreground (h, w), 255 or 0, of the next picture, BGR (h, w, 3) or grey (h, w).

        Without `learn` nothing that was learned changes; only the picture is remembered, as the one
        before the next. Pixels where `mask` (h, w) is 0 are not looked at: they are background and
        learn nothing. Raises ValueError for a picture or mask of the wrong type or size.
        """
        colour = _as_colour(picture)
        shape = colour.shape[:2]
        if self._tables is not None and self._tables.previous.shape != colour.shape:
            raise ValueError(
                f"the picture is {shape}, the model was started with {self._tables.previous.shape[:2]}"
            )
        if mask is None:
            watched = np.ones(shape, np.uint8)
        elif mask.shape == shape and mask.dtype in (np.uint8, np.bool_):
            watched = np.ascontiguousarray(mask).view(np.uint8)
        else:
            raise ValueError(f"the mask must be uint8 or bool {shape}, not {mask.dtype} {mask.shape}")
        if self._tables is None:
            self._tables = blank_tables(colour, self._options)
        found = self._judge(self._tables, colour, watched, learn)
        o = self._options
        if o.darkest_shadow < 1.0 and not is_grey(colour):
            remove_shadows(found, colour, self._tables.background, o.darkest_shadow, o.shadow_noise)
        np.copyto(self._tables.previous, colour)
        if learn:
            self._tables = replace(self._tables, frames=self._tables.frames + 1)
        return without_small(found, o.least_area)

    def _judge(self, tables: Tables, colour: Picture, watched: Mask, learn: bool) -> Mask:
        o = self._options
        differences = count_differences(colour, tables.background, tables.previous, watched)
        limits = change_limits(
            differences, o.change_sigmas, o.least_change, o.largest_change, o.largest_light
        )
        dx, dy = cv2.spatialGradient(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY))
        found = np.empty(watched.shape, np.uint8)
        arrays = tuple(tables.arrays.values())
        settled = bool(np.abs(limits[0].mean(axis=-1)).max() <= _SETTLED)
        settings = settings_of(o, tables.frames, learn, settled)
        if o.threads == 1:
            process(colour, dx, dy, watched, limits, arrays, settings, found)
            return found
        before = numba.get_num_threads()
        numba.set_num_threads(min(o.threads, numba.config.NUMBA_NUM_THREADS))
        try:
            process_parallel(colour, dx, dy, watched, limits, arrays, settings, found)
        finally:
            numba.set_num_threads(before)
        return found

    def background(self) -> Picture:
        """The background picture (h, w, 3). Raises ValueError before the first picture."""
        return np.round(self._learned().background).astype(np.uint8)

    def background_probability(self) -> NDArray[np.float32]:
        """p(b) of the static tables (h, w). Raises ValueError before the first picture."""
        tables = self._learned()
        return tables.static_prior / tables.static_gain

    def state(self) -> dict[str, NDArray[Any]]:
        """All that was learned as named arrays, copied. Raises ValueError before the first picture."""
        return to_arrays(self._learned()) | {"levels": self._levels}

    @classmethod
    def from_state(
        cls, state: Mapping[str, NDArray[Any]], options: BackgroundOptions | None = None
    ) -> StatisticalBackground:
        """A model that goes on from a `state`, with options of the same table sizes and levels.

        Raises ValueError where an array is missing or does not fit the options.
        """
        model = cls(options)
        levels = state.get("levels")
        if levels is None or not np.array_equal(levels, model._levels):
            raise ValueError(f"the state has levels {levels}, these options {model._levels}")
        tables = {name: array for name, array in state.items() if name != "levels"}
        model._tables = from_arrays(tables, model.options)
        return model

    @property
    def _levels(self) -> NDArray[np.int64]:
        return np.array([self._options.static_levels, self._options.dynamic_levels])

    def with_options(self, options: BackgroundOptions) -> StatisticalBackground:
        """A copy that goes on with other options from what was learned.

        Raises ValueError where the tables have other sizes or levels.
        """
        for name in _KEPT_BY_STATE:
            if self._tables is not None and getattr(options, name) != getattr(self._options, name):
                raise ValueError(f"{name} cannot change once something is learned")
        other = StatisticalBackground(options)
        if self._tables is not None:
            copies = {name: array.copy() for name, array in self._tables.arrays.items()}
            other._tables = Tables(frames=self._tables.frames, **copies)
        return other

    def _learned(self) -> Tables:
        if self._tables is None:
            raise ValueError("the model has seen no picture yet")
        return self._tables


def without_small(mask: Mask, least_area: int) -> Mask:
    """The mask (h, w) of 0 and 255 without its 8-connected regions of fewer pixels than that."""
    if least_area <= 1:
        return mask
    return keep_large(mask, least_area)


def _as_colour(picture: Picture) -> Picture:
    if picture.dtype != np.uint8:
        raise ValueError(f"the picture must be uint8, not {picture.dtype}")
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
        raise ValueError(f"the picture must be (h, w) or (h, w, 3), not {picture.shape}")
    if min(picture.shape[:2]) < 2:
        raise ValueError(f"the picture is too small: {picture.shape}")
    if picture.ndim == 2:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(picture)
