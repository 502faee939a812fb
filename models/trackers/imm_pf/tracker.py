"""Many targets, one IMM particle filter each (paper 2, section 5.3).

One picture: all particles move; targets are corrected from the nearest to the farthest (the lowest
row of the box first), each seeing the nearer ones as cover; targets end, and regions of foreground
that nobody explains bear new ones.

A target carries the log odds of its existence: with each picture they rise by the logarithm of its
mean likelihood over that of a box that holds no target. A newborn target is confirmed when they pass
a level. As in the paper a target ends when its mean likelihood stays under the threshold (that same
likelihood of an absent target) for some time; one that nearer targets hide is not judged, follows its
motion model, and ends only after a longer time. A target that ended is remembered for a while: a
confirmed newborn one near its last place that looks like it takes over its id.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import check_rng, check_shape
from lumpwatch.models.jdt.motion import MotionModel
from lumpwatch.models.roi import Image
from lumpwatch.models.state import SIZE, VX, VY, H, States, W, X, Y
from lumpwatch.models.trackers.foreground import Foreground
from lumpwatch.models.trackers.imm_pf.births import candidates, outside
from lumpwatch.models.trackers.imm_pf.filter import ImmBelief, ImmFilter, estimate, joint_weights, predict_all
from lumpwatch.models.trackers.imm_pf.observation import (
    PictureGrids,
    Reference,
    add,
    difference,
    observe,
    paint,
    reduced,
    refer,
)
from lumpwatch.models.trackers.imm_pf.options import TrackerOptions
from lumpwatch.models.trackers.imm_pf.size import BoxSize
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]


@dataclass(slots=True, eq=False, kw_only=True)
class _Target:
    id: int
    belief: ImmBelief
    reference: Reference
    state: Array
    """Mean of the particles (8,)."""
    spread: Array
    usual: float
    """Appearance cost that it has when it is seen."""
    log_odds: float
    confirmed: bool = False
    age_s: float = 0.0
    weak_s: float = 0.0
    hidden_s: float = 0.0
    twin_s: float = 0.0
    lost_s: float = 0.0


class ImmPfTracker:
    """Follows all targets in one camera's pictures; its state is bounded by what is in view."""

    def __init__(
        self,
        options: TrackerOptions,
        models: Sequence[MotionModel],
        size: BoxSize,
        foreground: Foreground,
        rng: np.random.Generator,
    ) -> None:
        """Raises ValueError where the options do not fit the number of models, or `rng` is no Generator."""
        check_rng(rng)
        self._options, self._size = options, size
        self._filter = ImmFilter(tuple(models), options.filter)
        self._foreground, self._rng = foreground, rng
        self._before: Image | None = None
        self._targets: list[_Target] = []
        self._lost: list[_Target] = []
        self._last_id = 0

    def step(self, picture: Image, dt: float) -> tuple[TrackedObject, ...]:
        """All objects after a BGR picture (h, w, 3), `dt` seconds after the last; unconfirmed ones as well.

        Raises ValueError for a dt that is not positive, a picture that is not (h, w, 3) of uint8, or one of another
        size than the last.
        """
        check_shape(picture, self._before.shape if self._before is not None else ("h", "w", 3), "picture")
        if picture.dtype != np.uint8:
            raise ValueError(f"picture must be of uint8, 0 to 255, not of {picture.dtype}")
        seen = reduced(picture, self._before, self._foreground.apply(picture))
        self._before = picture.copy()
        return self.advance(seen, dt)

    def run(self, pictures: Iterable[Image], dt: float) -> Iterator[tuple[TrackedObject, ...]]:
        """All objects after each BGR picture (h, w, 3), `dt` seconds apart; see `step`."""
        for picture in pictures:
            yield self.step(picture, dt)

    def advance(self, seen: PictureGrids, dt: float) -> tuple[TrackedObject, ...]:
        """The same for a picture that was looked at already."""
        if not 0.0 < dt < float("inf"):
            raise ValueError(f"dt must be positive and finite, not {dt}")
        self._update(seen, dt)
        self._end(seen, dt)
        o = self._options
        for state in candidates(seen, [target.state for target in self._targets], self._size, o):
            self._bear(seen, state)
        return tuple(_describe(target) for target in self._targets)

    def _update(self, seen: PictureGrids, dt: float) -> None:
        targets, o = self._targets, self._options
        if not targets:
            return
        moved = predict_all(
            self._filter.models,
            np.concatenate([target.belief.states for target in targets]),
            np.concatenate([target.belief.labels for target in targets]),
            dt,
            self._rng,
        )
        self._size.fill(moved)
        covered, claimed = np.zeros((2, *seen.colour.shape), np.uint8)
        clouds = dict(zip((target.id for target in targets), np.split(moved, len(targets)), strict=True))
        for target in targets:
            target.state = self._sized(joint_weights(target.belief) @ clouds[target.id])
            if target.confirmed:
                add(claimed, target.state, o.cover, 1)
        # Those who were never confirmed see all others as cover, and cover nobody.
        nearest_first = sorted(
            targets, key=lambda t: (t.confirmed, t.state[Y] + t.state[H] / 2), reverse=True
        )
        for target in nearest_first:
            if target.confirmed:
                add(claimed, target.state, o.cover, -1)
            expected = target.state
            self._correct(target, clouds[target.id], seen, (covered, claimed), dt)
            if target.confirmed:
                paint(covered, target.state, o.cover, 1)
                add(claimed, expected, o.cover, 1)

    def _correct(
        self, target: _Target, states: States, seen: PictureGrids, others: tuple[Image, Image], dt: float
    ) -> None:
        o, before = self._options, target.belief
        covered, claimed = others
        boxes = observe(
            seen,
            states,
            target.reference,
            target.usual,
            o.observation,
            covered=covered,
            claimed=claimed,
        )
        belief, log_evidence = self._filter.correct(before, states, -boxes.cost)
        weights = joint_weights(belief)
        after = estimate(belief)
        target.state, target.spread = self._sized(after.mean), after.spread
        target.belief = self._filter.resample(belief, before, self._rng)
        target.age_s += dt
        visible = float(weights @ boxes.visible)
        if visible < o.hidden_below:
            target.hidden_s += dt
            return
        target.hidden_s = 0.0
        keep = exp(-visible * dt / o.usual_s)
        target.usual = keep * target.usual + (1.0 - keep) * float(weights @ boxes.appearance)
        ratio = float(np.clip(log_evidence + o.absent_cost, -o.most_evidence, o.most_evidence))
        ratio *= visible * min(1.0, dt / o.independent_s)
        target.log_odds = float(np.clip(target.log_odds + ratio, -o.most_log_odds, o.most_log_odds))
        target.weak_s = target.weak_s + dt if log_evidence < -o.absent_cost else 0.0
        if target.log_odds > o.confirm_log_odds and not target.confirmed:
            target.confirmed = True
            self._recognise(target)

    def _recognise(self, target: _Target) -> None:
        """Give a newly confirmed target the id of the one that was lost here, if it looks like it."""
        o = self._options
        best, known = np.inf, None
        for lost in self._lost:
            reach = o.lost_reach * target.state[H] * (0.5 + lost.lost_s)
            # People do not walk on unseen in one direction for long.
            expected = lost.state[[X, Y]] + lost.state[[VX, VY]] * min(lost.lost_s, 1.0)
            gap = float(np.hypot(*(target.state[[X, Y]] - expected))) / reach
            apart = difference(lost.reference, target.reference)
            if gap < 1.0 and apart < o.lost_distance and gap + apart < best:
                best, known = gap + apart, lost
        if known is not None:
            self._lost.remove(known)
            target.id = known.id

    def _end(self, seen: PictureGrids, dt: float) -> None:
        o = self._options
        for lost in self._lost:
            lost.lost_s += dt
        self._lost = [lost for lost in self._lost if lost.lost_s < o.lost_s]
        kept = []
        for target in self._targets:
            target.twin_s = max(target.twin_s + (dt if self._is_twin(target) else -dt), 0.0)
            gone = (
                target.weak_s > o.weak_s
                or target.hidden_s > o.hidden_s
                or target.twin_s > (o.twin_s if target.confirmed else 0.0)
                or (not target.confirmed and target.log_odds < o.drop_log_odds)
            )
            if outside(target.state, seen.shape, o.edge):
                continue
            if not gone:
                kept.append(target)
            elif target.confirmed:
                self._lost.append(target)
        self._targets = kept

    def _is_twin(self, target: _Target) -> bool:
        """Whether it lies on an older, confirmed target."""
        return any(
            other.confirmed
            and (other.age_s, -other.id) > (target.age_s, -target.id)
            and _overlap(other.state, target.state) > self._options.twin_overlap
            for other in self._targets
        )

    def _bear(self, seen: PictureGrids, state: Array) -> None:
        o = self._options
        spread = np.zeros(SIZE)
        spread[[X, Y]] = o.birth_spread * state[H]
        spread[[VX, VY]] = o.birth_speed * state[H] * np.array([1.0, 1.0 / 3.0])
        belief = self._filter.start(state, spread, self._rng)
        self._size.fill(belief.states)
        reference = refer(seen, state, o.observation)
        self._last_id += 1
        self._targets.append(
            _Target(
                id=self._last_id,
                belief=belief,
                reference=reference,
                state=state,
                spread=spread,
                usual=o.usual_appearance,
                log_odds=o.birth_log_odds,
            )
        )

    def _sized(self, state: Array) -> Array:
        row = state[None].copy()
        self._size.fill(row)
        return np.asarray(row[0])


def _describe(target: _Target) -> TrackedObject:
    return TrackedObject(
        id=target.id,
        box=target.state[[X, Y, W, H]],
        velocity=target.state[[VX, VY]],
        spread=target.spread[[X, Y]],
        existence=1.0 / (1.0 + exp(-target.log_odds)),
        confirmed=target.confirmed,
        model_shares=target.belief.shares.copy(),
    )


def _overlap(a: Array, b: Array) -> float:
    """Intersection over union of the boxes of two states."""
    w = min(a[X] + a[W] / 2, b[X] + b[W] / 2) - max(a[X] - a[W] / 2, b[X] - b[W] / 2)
    h = min(a[Y] + a[H] / 2, b[Y] + b[H] / 2) - max(a[Y] - a[H] / 2, b[Y] - b[H] / 2)
    if w <= 0.0 or h <= 0.0:
        return 0.0
    return float(w * h / (a[W] * a[H] + b[W] * b[H] - w * h))
