"""Likelihood of a large lump among ore.

A net looks at the picture once (`net`) and says of each cell whether it lies on a body with an outline, whether an
outline passes, and where the sides of its body are. How well one body of a box's own size explains that is measured
by a handful of means over the box, its core, its rim, the ring around it and its wider surroundings: are the cells
on a body, even those of the weakest quarter, do their bodies' sides agree with the box's and with each other, is the
outline at the rim, even along the weakest side, and how large is the box against what else lies there. All come from
integral images (`maps`), so a box costs the same whatever its size. A logistic regression weighs them, their squares
and what several say together (`patterns`). Trained on equally many boxes with and without a lump, its logit is the
log likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.likelihood.base import LEAST_INSIDE, bounded, box_inside
from lumpwatch.models.likelihood.maps import (
    AREA,
    BODY,
    EDGE,
    GRAIN_PX,
    SIZE,
    SUMS,
    VOTES,
    cell_shares,
    prepare,
)
from lumpwatch.models.likelihood.net import STRIDE
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns
from lumpwatch.models.roi import Image, View
from lumpwatch.models.state import States

FEATURES = (
    "body",
    "body_core",
    "body_ring",
    "edge_core",
    "edge_rim",
    "edge_ring",
    "edge_weakest",
    "edge_second",
    "body_weakest",
    "votes",
    "close_votes",
    "agreement",
    "left",
    "upper",
    "right",
    "lower",
    "size_around",
    "size_ring",
    "size_usual",
    "bodies_around",
    "bodies_usual",
    "size",
    "aspect",
)
"""What `features` tells, in order."""
WEIGHTS = 2 * len(FEATURES)
"""Of the features, and of their squares; further ones are those of patterns."""

Maps = Callable[[Image], NDArray[np.float32]]
"""Grey picture (h, w) -> maps (6, rows, columns) in the order of `net.HEADS`."""

_CORE, _RIM, _RING, _AROUND = 0.6, 1.12, 1.5, 3.0
"""Sizes in units of the box."""
_ASKED = 5
"""Cells of a box that are asked for the sides of their body, each way; the corners are not."""
_SLOTS = 32  # for the 21 that are asked; the others stay without a body
_PER_ASKED = np.float32(1.0 / (_ASKED * _ASKED - 4))
_LEAST_BODY = 0.5
"""What the box's own sides count among those of the bodies that its cells tell: where there is none, they agree."""
_CLOSE, _FAR = 0.4, 1.2
"""How far sides may be off, all four together in units of the box, for half of a vote."""
_MOST_OFF = 0.6
"""A side that is further off, in units of the box, is off as far as that."""
_GRAIN = float(np.log(GRAIN_PX))
_USUAL = 0.23
"""Size of a lump in units of the picture's height, where nothing is known."""
_FEW_BODIES = 4.0  # cells
_ONE = np.float32(1.0)
_LIMIT = 5.0  # standard deviations
_FEATURES = len(FEATURES)


@dataclass(slots=True)
class LumpLikelihood:
    """A logistic score on the features, tempered and bounded."""

    maps: Maps
    mean: NDArray[np.float64]
    """Mean of each feature in training (23,)."""
    scale: NDArray[np.float64]
    """Standard deviation of each feature in training (23,)."""
    weights: NDArray[np.float64]
    """Weights of the standardised features, of their squares, and of the patterns (46 + k,)."""
    offset: float
    evidence: float
    """Share of a frame's log ratio that counts, where `looks_per_s` is not given."""
    bound: float
    looks_per_s: float | None = None
    """How many independent looks a second of frames is worth."""
    patterns: Patterns = field(default_factory=lambda: no_patterns(_FEATURES))
    margin: float = 0.0
    """How far the logit must lie above zero before a box speaks for a lump."""
    expected: NDArray[np.float64] | None = None
    """Log size, px, that lumps have at each row of the picture (h,); None: the same share of its height everywhere."""
    _memory: tuple[NDArray[np.float64], NDArray[np.float32]] = field(init=False, repr=False)
    """Integral images and votes of the picture seen last."""
    _region: tuple[NDArray[np.int32], NDArray[np.float32]] | None = field(init=False, repr=False)
    """The polygon seen last, and its cells' shares of it."""
    patterns_in_short: Patterns = field(init=False, repr=False)
    """The patterns as float32."""

    def __post_init__(self) -> None:
        directions, offsets = (
            x.astype(np.float32) for x in (self.patterns.directions, self.patterns.offsets)
        )
        self.patterns_in_short = Patterns(directions, offsets)  # type: ignore[arg-type]
        self._memory = np.zeros((0, 0, SUMS)), np.zeros((0, 0, VOTES), np.float32)
        self._region = None

    def observe(self, view: View, dt: float = inf) -> LumpObservation:
        """Let the net look at the picture."""
        share = self.evidence if self.looks_per_s is None else min(1.0, self.looks_per_s * dt)
        return self.observe_maps(self.maps(view.gray), view, share)

    def observe_maps(
        self,
        maps: NDArray[np.float32],
        view: View,
        share: float = 1.0,
        expected: NDArray[np.float64] | None = None,
    ) -> LumpObservation:
        """What `observe` makes of a picture whose maps are known; `expected` in place of the likelihood's own."""
        expected = self.expected if expected is None else expected
        if expected is None:
            height = view.gray.shape[0]
            expected = np.full(height, np.log(_USUAL * height))
        if self._region is None or self._region[0] is not view.inside:
            self._region = view.inside, cell_shares(view.inside)
            rows, columns = self._region[1].shape
            votes = np.zeros((rows, columns, VOTES), np.float32)
            self._memory = np.zeros((rows + 1, columns + 1, SUMS)), votes
        prepare(maps, self._region[1], *self._memory)
        return LumpObservation(self, *self._memory, view.inside, expected, share)


@dataclass(frozen=True, slots=True)
class LumpObservation:
    """What is known of one picture."""

    likelihood: LumpLikelihood
    sums: NDArray[np.float64]
    votes: NDArray[np.float32]
    """See `maps.prepare`."""
    inside: NDArray[np.int32]
    expected: NDArray[np.float64]
    """Log size, px, that lumps have at each row (h,)."""
    share: float
    """Share of the log ratio that counts: what is new since the last picture."""

    def features(self, states: States) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (n, 23) of the states' boxes, and whether each box lies in the polygon (n,)."""
        return _features(self.sums, self.votes, self.inside, self.expected, states, LEAST_INSIDE)

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered logit (n,); -inf for a box that leaves the polygon.

        What several features say together is told in half as many digits, to 1e-6 of the score.
        """
        model = self.likelihood
        linear, square, joint = np.split(model.weights, (_FEATURES, WEIGHTS))
        scores, z = _scores(
            self.sums, self.votes, self.inside, self.expected, states, LEAST_INSIDE,
            model.mean, model.scale, model.offset, linear, square,
        )  # fmt: skip
        if len(joint):
            scores += model.patterns_in_short.responses(z) @ joint
        return scores

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        model = self.likelihood
        return bounded(self.score(states) - model.margin, self.share, model.bound)


def neutral(maps: Maps) -> LumpLikelihood:
    """One without an opinion, to ask for features."""
    n = len(FEATURES)
    return LumpLikelihood(maps, np.zeros(n), np.ones(n), np.zeros(WEIGHTS), 0.0, 1.0, inf)


def standardised(
    features: NDArray[np.float64], mean: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Features (n, 23) in standard deviations from their mean, limited to five of them."""
    return np.clip((features - mean) / scale, -_LIMIT, _LIMIT)


def expand(z: NDArray[np.float64], patterns: Patterns) -> NDArray[np.float64]:
    """What the weights belong to: standardised features, their squares, and the patterns' responses (n, 46 + k)."""
    return np.hstack([z, z * z, patterns.responses(z)])


@njit(cache=True, error_model="numpy")
def _cells(state, scale, rows, columns):  # type: ignore[no-untyped-def]
    """Edges x0, y0, x1, y1 in cells of a state's box, `scale` times as large, one cell at least, clipped."""
    half_w, half_h = 0.5 * scale * state[6] / STRIDE, 0.5 * scale * state[7] / STRIDE
    x, y = state[0] / STRIDE, state[1] / STRIDE
    x0, x1 = int(np.floor(x - half_w + 0.5)), int(np.floor(x + half_w + 0.5))
    y0, y1 = int(np.floor(y - half_h + 0.5)), int(np.floor(y + half_h + 0.5))
    if x1 <= x0:
        x0 = int(np.floor(x))
        x1 = x0 + 1
    if y1 <= y0:
        y0 = int(np.floor(y))
        y1 = y0 + 1
    return (
        min(max(x0, 0), columns), min(max(y0, 0), rows), min(max(x1, 0), columns), min(max(y1, 0), rows)
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _sum(integral, box, k):  # type: ignore[no-untyped-def]
    """What is summed under `k`, over a box of cells."""
    x0, y0, x1, y1 = box
    return integral[y1, x1, k] - integral[y0, x1, k] - integral[y1, x0, k] + integral[y0, x0, k]


@njit(cache=True, error_model="numpy")
def _looks(integral, box, out):  # type: ignore[no-untyped-def]
    """Area, body, edge and size of a box of cells."""
    for k in range(SUMS):
        out[k] = _sum(integral, box, k)


@njit(cache=True, error_model="numpy")
def _sides(inner, outer):  # type: ignore[no-untyped-def]
    """The four boxes of cells between the sides of two boxes, corners left out."""
    return (
        (outer[0], inner[1], inner[0], inner[3]),
        (inner[0], outer[1], inner[2], inner[1]),
        (inner[2], inner[1], outer[2], inner[3]),
        (inner[0], inner[3], inner[2], outer[3]),
    )


@njit(cache=True, error_model="numpy")
def _quarters(box):  # type: ignore[no-untyped-def]
    """The four quarters of a box of cells."""
    x0, y0, x1, y1 = box
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    return (x0, y0, x, y), (x, y0, x1, y), (x0, y, x, y1), (x, y, x1, y1)


@njit(cache=True, error_model="numpy")
def _two_least(integral, boxes, k, otherwise):  # type: ignore[no-untyped-def]
    """The two least means of one map over boxes of cells; what lies outside the polygon by half is not asked."""
    least, second = np.inf, np.inf
    for box in boxes:
        area, cells = _sum(integral, box, AREA), (box[2] - box[0]) * (box[3] - box[1])
        if area > 0.5 * cells:
            value = _sum(integral, box, k) / area
            if value < least:
                least, second = value, least
            elif value < second:
                second = value
    return least if least < np.inf else otherwise, second if second < np.inf else otherwise


@njit(cache=True, error_model="numpy")
def _ask(votes, state, told):  # type: ignore[no-untyped-def]
    """Write what the cells asked say (VOTES, _SLOTS); those outside the picture see no body."""
    rows, columns = votes.shape[0], votes.shape[1]
    step_x, step_y = state[6] / (STRIDE * _ASKED), state[7] / (STRIDE * _ASKED)
    x0, y0 = state[0] / STRIDE - 0.5 * (_ASKED - 1) * step_x, state[1] / STRIDE - 0.5 * (_ASKED - 1) * step_y
    n = 0
    for i in range(_ASKED):
        y = int(np.floor(y0 + i * step_y))
        skipped = 1 if i == 0 or i == _ASKED - 1 else 0
        for j in range(skipped, _ASKED - skipped):
            x = int(np.floor(x0 + j * step_x))
            if 0 <= x < columns and 0 <= y < rows:
                for k in range(VOTES):
                    told[k, n] = votes[y, x, k]
            else:
                told[0, n] = 0.0
            n += 1


@njit(cache=True, error_model="numpy", fastmath=True)
def _count(told, state, out):  # type: ignore[no-untyped-def]
    """Write votes, close votes, agreement and how far the four sides are off.

    The order of sums is the compiler's: all cells at once, to a digit of single precision.
    """
    w, h = np.float32(state[6]), np.float32(state[7])
    x0, y0 = np.float32(state[0]) - np.float32(0.5) * w, np.float32(state[1]) - np.float32(0.5) * h
    x1, y1 = x0 + w, y0 + h
    per_w, per_h, most = _ONE / w, _ONE / h, np.float32(_MOST_OFF)
    per_close, per_far = np.float32(1.0 / _CLOSE**2), np.float32(1.0 / _FAR**2)
    zero = np.float32(0.0)
    bodies, far, close, left, upper, right, lower = zero, zero, zero, zero, zero, zero, zero
    for n in range(_SLOTS):
        body = told[0, n]
        a, b = (told[1, n] - x0) * per_w, (told[2, n] - y0) * per_h
        c, d = (told[3, n] - x1) * per_w, (told[4, n] - y1) * per_h
        off = abs(a) + abs(b) + abs(c) + abs(d)
        off *= off
        bodies += body
        close += body / (_ONE + off * per_close)
        far += body / (_ONE + off * per_far)
        left += body * min(max(a, -most), most)
        upper += body * min(max(b, -most), most)
        right += body * min(max(c, -most), most)
        lower += body * min(max(d, -most), most)
    per_body = _ONE / (bodies + np.float32(_LEAST_BODY))
    out[9], out[10], out[11] = far * _PER_ASKED, close * _PER_ASKED, far * per_body
    out[12], out[13], out[14], out[15] = left * per_body, upper * per_body, right * per_body, lower * per_body


@njit(cache=True, error_model="numpy")
def _measure(integral, votes, inside, usual, bodies, expected, state, least_inside, memory, told, out):  # type: ignore[no-untyped-def]
    """Write the features (23,) of one state's box; False, and nothing written, where it is no object."""
    if state[6] < 3.0 or state[7] < 3.0:
        return False
    _, share = box_inside(inside, state)
    if share < least_inside:
        return False
    rows, columns = integral.shape[0] - 1, integral.shape[1] - 1
    core, box, rim, ring, around = memory[0], memory[1], memory[2], memory[3], memory[4]
    inner, middle, outer = (
        _cells(state, _CORE, rows, columns), _cells(state, 1.0, rows, columns), _cells(state, _RIM, rows, columns)
    )  # fmt: skip
    _looks(integral, inner, core)
    _looks(integral, middle, box)
    _looks(integral, outer, rim)
    _looks(integral, _cells(state, _RING, rows, columns), ring)
    _looks(integral, _cells(state, _AROUND, rows, columns), around)
    in_core, in_box = 1.0 / max(core[AREA], 0.5), 1.0 / max(box[AREA], 0.5)
    in_rim = 1.0 / max(rim[AREA] - core[AREA], 0.5)
    in_ring = 1.0 / max(ring[AREA] - rim[AREA], 0.5)
    in_around = 1.0 / max(around[AREA] - rim[AREA], 0.5)
    out[0] = box[BODY] * in_box
    out[1] = core[BODY] * in_core
    out[2] = (ring[BODY] - rim[BODY]) * in_ring
    out[3] = core[EDGE] * in_core
    out[4] = (rim[EDGE] - core[EDGE]) * in_rim
    out[5] = (ring[EDGE] - rim[EDGE]) * in_ring
    out[6], out[7] = _two_least(integral, _sides(inner, outer), EDGE, out[4])
    out[8], _ = _two_least(integral, _quarters(middle), BODY, out[0])
    _ask(votes, state, told)
    _count(told, state, out)
    log_w, log_h = np.log(state[6]), np.log(state[7])
    size = 0.5 * (log_w + log_h)
    out[16] = size - (around[SIZE] - rim[SIZE]) * in_around
    out[17] = size - (ring[SIZE] - rim[SIZE]) * in_ring
    out[18] = size - usual
    out[19] = size - _of_bodies(
        around[AREA] - rim[AREA], around[BODY] - rim[BODY], around[SIZE] - rim[SIZE]
    )  # fmt: skip
    out[20] = size - bodies
    row = min(max(int(state[1]), 0), len(expected) - 1)
    out[21] = size - expected[row]
    out[22] = log_w - log_h
    return True


@njit(cache=True, error_model="numpy")
def _of_bodies(area, body, size):  # type: ignore[no-untyped-def]
    """Mean log size of bodies, px, from sums over cells; where there are hardly any, that of ore."""
    return _GRAIN + (size - area * _GRAIN) / (body + _FEW_BODIES)


@njit(cache=True, error_model="numpy")
def _features(integral, votes, inside, expected, states, least_inside):  # type: ignore[no-untyped-def]
    out = np.zeros((len(states), _FEATURES))
    valid = np.zeros(len(states), dtype=np.bool_)
    memory, told = np.empty((5, SUMS)), np.zeros((VOTES, _SLOTS), np.float32)
    whole = integral[-1, -1]
    usual, bodies = whole[SIZE] / max(whole[AREA], 1e-9), _of_bodies(whole[AREA], whole[BODY], whole[SIZE])
    for i in range(len(states)):
        state = states[i]
        valid[i] = _measure(
            integral, votes, inside, usual, bodies, expected, state, least_inside, memory, told, out[i]
        )
    return out, valid


@njit(cache=True, error_model="numpy")
def _scores(integral, votes, inside, expected, states, least_inside, mean, scale, offset, linear, square):  # type: ignore[no-untyped-def]
    """The features and their squares times the weights (n,), and the standardised features (n, 23)."""
    out, z = np.full(len(states), -np.inf), np.zeros((len(states), _FEATURES), np.float32)
    memory, told = np.empty((5, SUMS)), np.zeros((VOTES, _SLOTS), np.float32)
    features, per_scale = np.empty(_FEATURES), 1.0 / scale
    whole = integral[-1, -1]
    usual, bodies = whole[SIZE] / max(whole[AREA], 1e-9), _of_bodies(whole[AREA], whole[BODY], whole[SIZE])
    for i in range(len(states)):
        if _measure(
            integral, votes, inside, usual, bodies, expected, states[i], least_inside, memory, told, features
        ):
            score = offset
            for k in range(_FEATURES):
                value = min(max((features[k] - mean[k]) * per_scale[k], -_LIMIT), _LIMIT)
                score += value * (linear[k] + value * square[k])
                z[i, k] = value
            out[i] = score
    return out, z
