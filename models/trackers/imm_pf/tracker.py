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
from math import exp

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import check_positive, check_rng, check_shape
from lumpwatch.models.jdt.motion import MotionModel
from lumpwatch.models.roi import Image
from lumpwatch.models.state import SIZE, VX, VY, H, States, X, Y
from lumpwatch.models.trackers.foreground import Foreground
from lumpwatch.models.trackers.imm_pf.births import candidates, outside
from lumpwatch.models.trackers.imm_pf.filter import ImmFilter, estimate, joint_weights, predict_all
from lumpwatch.models.trackers.imm_pf.observation import (
    STEP,
    PictureGrids,
    add,
    observe,
    paint,
    reduced,
    refer,
)
from lumpwatch.models.trackers.imm_pf.options import TrackerOptions
from lumpwatch.models.trackers.imm_pf.recognition import Recognition
from lumpwatch.models.trackers.imm_pf.size import BoxSize
from lumpwatch.models.trackers.imm_pf.target import Target, described, overlap
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]


class ImmPfTracker:
    """Follows all targets in one camera's pictures; its state is bounded by what is in view."""

    def __init__(
        self,
        options: TrackerOptions,
        models: Sequence[MotionModel],
        size: BoxSize,
        foreground: Foreground,
        rng: np.random.Generator,
        cover: Image | None = None,
    ) -> None:
        """`cover` (h, w) is not 0 where scenery stands before targets: it hides them as nearer targets do.

        Raises ValueError where the options do not fit the number of models, or `rng` is no Generator.
        """
        check_rng(rng)
        self._options, self._size = options, size
        self._filter = ImmFilter(tuple(models), options.filter)
        self._foreground, self._rng = foreground, rng
        self._cover = None if cover is None else (cover[::STEP, ::STEP] != 0).astype(np.uint8)
        self._before: Image | None = None
        self._targets: list[Target] = []
        self._recognition = Recognition(options)
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
        check_positive(dt, "dt")
        self._update(seen, dt)
        self._end(seen, dt)
        confirmed = [target for target in self._targets if target.confirmed]
        self._recognition.tell_apart(confirmed, seen, dt)
        o = self._options
        for state in candidates(seen, [target.state for target in self._targets], self._size, o):
            self._bear(seen, state)
        return tuple(described(target) for target in self._targets)

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
        if self._cover is not None:
            covered[:] = self._cover
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
        self, target: Target, states: States, seen: PictureGrids, others: tuple[Image, Image], dt: float
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
        visible = target.visible = float(weights @ boxes.visible)
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
            self._recognition.recognise(target)

    def _end(self, seen: PictureGrids, dt: float) -> None:
        o = self._options
        self._recognition.forget(dt)
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
                self._recognition.lose(target)
        self._targets = kept

    def _is_twin(self, target: Target) -> bool:
        """Whether it lies on an older, confirmed target."""
        return any(
            other.confirmed
            and (other.age_s, -other.id) > (target.age_s, -target.id)
            and overlap(other.state, target.state) > self._options.twin_overlap
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
            Target(
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
