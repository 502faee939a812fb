"""Boxes to learn from: on an object, beside it, badly on it, and where the filter would be taken in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths
from lumpwatch.models.likelihood.lump import LumpObservation
from lumpwatch.models.roi import View
from lumpwatch.models.state import H, States, W, X, Y, blank

_JITTERED = 4
TRIED = 400
_SEEDS, _CLIMBS, _MOVES, _HARD = 8, 3, 12, 3
_MOVE_S = 0.5  # as far as sizes wander in that time
_MOST_OVERLAP = 0.25
_TOUCHING = 0.1
_TOO_SMALL, _TOO_LARGE = (-0.8, -0.4), (0.4, 0.7)
"""Log of the scale."""
_BADLY, _BAD_OVERLAP = 64, 0.3
_SHIFT, _SQUEEZE = 0.3, 0.1


@dataclass(frozen=True, slots=True)
class LabelledView:
    """One working picture with the objects in it."""

    view: View
    objects: States
    """States of the labelled objects (n, 8), n may be 0."""
    doubtful: States = field(default_factory=lambda: blank(0))
    """States of what is neither an object to learn from nor background (m, 8)."""

    @property
    def taken(self) -> States:
        """Where background is not to be looked for (n + m, 8)."""
        return np.concatenate([self.objects, self.doubtful]) if len(self.doubtful) else self.objects


def mistaken(
    seen: LumpObservation, births: PolygonBirths, objects: States, rng: np.random.Generator
) -> States:
    """Boxes (n, 8) without an object that the likelihood takes for one most readily, n at most `_HARD`.

    Particles gather where the score is best, so these climb too: each of the best boxes of many becomes the
    best of its neighbours, a few times.
    """
    tried = births.draw(TRIED, rng)[0]
    tried = tried[~_touching(tried, objects)]
    score = seen.score(tried)
    best = tried[np.argsort(-score, kind="stable")[:_SEEDS]]
    if len(best) == 0:
        return best
    for _ in range(_CLIMBS):
        around = np.repeat(best, _MOVES, axis=0)
        moved = around.copy()
        moved[:, X : Y + 1] += 0.1 * around[:, W : H + 1] * rng.standard_normal((len(around), 2))
        births.profile.follow(around, moved, _MOVE_S, rng)
        families = np.concatenate([best[:, None], moved.reshape(len(best), _MOVES, 8)], axis=1)
        score = seen.score(families.reshape(-1, 8))
        score[_touching(families.reshape(-1, 8), objects)] = -np.inf
        score = score.reshape(len(best), -1)
        best, score = families[np.arange(len(best)), score.argmax(axis=1)], score.max(axis=1)
    order = np.argsort(-score, kind="stable")[:_HARD]
    return best[order[np.isfinite(score[order])]]


def jitter(objects: States, rng: np.random.Generator) -> States:
    """Each object a few times, moved and scaled by a few percent of its size."""
    moved = np.repeat(objects, _JITTERED, axis=0)
    n = len(moved)
    moved[:, X : Y + 1] += 0.06 * moved[:, W : H + 1] * rng.standard_normal((n, 2))
    moved[:, W : H + 1] *= np.exp(0.08 * rng.standard_normal((n, 2)))
    return moved


def misfits(objects: States, rng: np.random.Generator) -> States:
    """Boxes on each object that are much too small or too large: they would tell a wrong size."""
    n = len(objects)
    moved = np.repeat(objects, 2, axis=0)
    scale = np.exp(np.column_stack([rng.uniform(*_TOO_SMALL, n), rng.uniform(*_TOO_LARGE, n)])).reshape(-1, 1)
    apart = np.abs(1.0 - scale) * moved[:, W : H + 1]
    moved[:, X : Y + 1] += 0.5 * apart * rng.uniform(-1.0, 1.0, (2 * n, 2))
    moved[:, W : H + 1] *= scale
    return moved


def tempting(seen: LumpObservation, objects: States, rng: np.random.Generator) -> States:
    """The box that lies badly on each object and that the likelihood likes most (n, 8), n at most one an object.

    A track that sits on the best-looking part of a lump follows it to the lip, and tells a wrong size.
    """
    chosen = [objects[:0]]
    for one in objects:
        tried = np.repeat(one[None], _BADLY, axis=0)
        log_scale = rng.uniform(_TOO_SMALL[0], _TOO_LARGE[1], (_BADLY, 1))
        scale = np.exp(log_scale + _SQUEEZE * rng.standard_normal((_BADLY, 2)))
        reach = np.maximum(np.abs(1.0 - scale), _SHIFT) * one[W : H + 1]
        tried[:, W : H + 1] *= scale
        tried[:, X : Y + 1] += 0.5 * reach * rng.uniform(-1.0, 1.0, (_BADLY, 2))
        tried = tried[_overlap(tried, objects).max(axis=1) < _BAD_OVERLAP]
        score = seen.score(tried)
        if np.isfinite(score).any():
            chosen.append(tried[[int(score.argmax())]])
    return np.concatenate(chosen)


def elsewhere(states: States, objects: States) -> States:
    """The states whose box overlaps no object by more than a quarter (intersection over union)."""
    if len(objects) == 0:
        return states
    return states[_overlap(states, objects).max(axis=1) < _MOST_OVERLAP]


def _touching(states: States, objects: States) -> NDArray[np.bool_]:
    """Whether more than a tenth of a state's box lies on an object: a part of a lump is no mistake to learn from."""
    if len(objects) == 0:
        return np.zeros(len(states), np.bool_)
    return (_common(states, objects) / np.prod(states[:, None, W : H + 1], axis=-1)).max(axis=1) > _TOUCHING


def _common(a: States, b: States) -> NDArray[np.float64]:
    """The area that boxes have in common, of all pairs (n, m)."""
    half_a, half_b = a[:, None, W : H + 1] / 2, b[None, :, W : H + 1] / 2
    centre_a, centre_b = a[:, None, X : Y + 1], b[None, :, X : Y + 1]
    low = np.maximum(centre_a - half_a, centre_b - half_b)
    high = np.minimum(centre_a + half_a, centre_b + half_b)
    return np.prod(np.maximum(high - low, 0.0), axis=-1)


def _overlap(a: States, b: States) -> NDArray[np.float64]:
    """Intersection over union of all pairs of boxes (n, m)."""
    common = _common(a, b)
    areas = (a[:, W] * a[:, H])[:, None] + (b[:, W] * b[:, H])[None, :]
    return common / np.maximum(areas - common, 1e-9)
