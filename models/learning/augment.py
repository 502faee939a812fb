"""The same picture in another light: what a minute of footage does not show of nights and dust."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from models.roi import Image, View


def altered(view: View, rng: np.random.Generator) -> View:
    """The view with less contrast, another gain, blur and noise, each drawn at random; luma only."""
    return replace(view, gray=_altered(view.gray, rng), colour=None)


def _altered(gray: Image, rng: np.random.Generator) -> Image:
    picture = np.asarray(gray, np.float32)
    veil, gain = rng.uniform(0.0, 0.6), float(np.exp(rng.uniform(-0.9, 0.3)))
    # Dust and steam take away and scatter light; so does fog on the lens.
    picture = np.asarray(gain * (picture + veil * (150.0 - picture)), np.float32)
    if rng.random() < 0.5:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.2)), np.float32)
    noise = rng.standard_normal(gray.shape, dtype=np.float32)
    if rng.random() < 0.5:  # grain of several pixels, as compression and infra-red cameras leave it
        noise = np.asarray(2.5 * cv2.GaussianBlur(noise, (0, 0), 0.8), np.float32)
    picture += rng.uniform(0.0, 9.0) * noise
    return np.asarray(np.clip(picture, 0, 255), np.uint8)
