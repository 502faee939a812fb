"""The options of the background model as its kernels want them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lumpwatch.models.trackers.background.options import BackgroundOptions


class Settings(NamedTuple):
    """Numbers for one frame."""

    learn: bool
    all_background: bool
    """Take every pixel for background, whatever it looks like."""
    keep: bool
    """Whether the old background stays known after a once-off change."""
    paper: bool
    """Whether a pixel that moved is judged by co-occurrence alone."""
    growth: np.float32
    """1 / (1 - alpha)."""
    rate: np.float32
    """Alpha."""
    every: int
    """Rows whose pixels are known learn in every so many frames."""
    phase: int
    """The remainder of the rows whose turn it is."""
    known_growth: np.float32
    """Growth and rate of so many frames at once."""
    known_rate: np.float32
    background_rate: np.float32
    """Beta."""
    once_off_share: np.float32
    """M."""
    static_shift: int
    """Bits that quantising to static_levels takes away."""
    static_used: int
    static_distance: np.float32
    colour_floor: np.float32
    """Squared distance below which colours are the same."""
    gradient_floor: np.float32
    dynamic_shift: int
    dynamic_used: int
    dynamic_distance: int


def settings_of(options: BackgroundOptions, frames: int, learn: bool, settled: bool) -> Settings:
    """The settings for the frame after `frames` others; `settled`: the light is that of the background picture."""
    starting = learn and frames < options.initial_frames
    rate = options.initial_rate if starting else options.learning_rate
    every = options.learn_every if settled and not starting else 1
    floor = options.noise_floor * options.static_levels / 256
    return Settings(
        learn=learn,
        all_background=starting,
        keep=options.once_off == "keep",
        paper=options.rule == "paper",
        growth=np.float32(1.0 / (1.0 - rate)),
        rate=np.float32(rate),
        every=every,
        phase=frames % every,
        known_growth=np.float32((1.0 - rate) ** -every),
        known_rate=np.float32(1.0 - (1.0 - rate) ** every),
        background_rate=np.float32(options.background_rate),
        once_off_share=np.float32(options.once_off_share),
        static_shift=9 - options.static_levels.bit_length(),
        static_used=options.static_used,
        static_distance=np.float32(options.static_distance),
        colour_floor=np.float32(3.0 * floor**2),
        gradient_floor=np.float32(2.0 * floor**2),
        dynamic_shift=9 - options.dynamic_levels.bit_length(),
        dynamic_used=options.dynamic_used,
        dynamic_distance=options.dynamic_distance,
    )
