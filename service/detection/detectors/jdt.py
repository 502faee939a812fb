"""The JDT filter of a ROI with its belief, random generator and prior (paper 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.filter import Diagnostics, JdtFilter
from lumpwatch.models.jdt.multi_object import Appearance, MultiBelief, MultiJdtFilter
from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.likelihood import Observation
from lumpwatch.models.likelihood.lump import LumpObservation, Maps
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import VX, VY, Belief, Estimate, H, W, X, Y
from lumpwatch.models.trackers.appearance import HistogramAppearance
from lumpwatch.service.config import JdtConfig
from lumpwatch.service.core import DetectedObject, Detection
from lumpwatch.service.detection.detectors import jdt_state
from lumpwatch.service.detection.detectors.base import LONGEST_STEP_S, SHOWN_ABOVE, FilterState
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S, make_filter, make_likelihood


@dataclass(frozen=True, slots=True)
class _Found:
    """One object as a filter has it."""

    id: int
    existence: float
    estimate: Estimate


class _Engine(Protocol):
    """A filter with its belief: for one object, or for several."""

    log_evidence: float
    """Sum over all frames."""

    @property
    def existence(self) -> float:
        """P(at least one object exists)."""

    def use(self, single: JdtFilter) -> None:
        """Go on with other fixed parts."""

    def step(
        self, observation: Observation, appearance: Callable[[], Appearance], dt: float
    ) -> tuple[list[_Found], Diagnostics]:
        """One frame."""

    def search_anew(self, dt: float) -> None:
        """Forget where everything was; what exists goes on by its Markov chain."""

    def clouds(self) -> tuple[Belief, ...]:
        """All particle clouds."""

    def state(self) -> FilterState:
        """All that changes, but the random generator."""

    def restore(self, state: FilterState) -> None:
        """Go on from there. Raises StateMismatchError."""


class _Single:
    """One object at most."""

    def __init__(self, single: JdtFilter, rng: np.random.Generator) -> None:
        self._filter, self._rng = single, rng
        self._belief = single.start(rng)
        self._id, self._present = 0, False

    log_evidence = 0.0

    @property
    def existence(self) -> float:
        return self._belief.existence

    def use(self, single: JdtFilter) -> None:
        self._filter = single

    def step(
        self, observation: Observation, appearance: Callable[[], Appearance], dt: float
    ) -> tuple[list[_Found], Diagnostics]:
        step = self._filter.step(self._belief, observation, dt, self._rng)
        self._belief = step.belief
        self.log_evidence += step.log_evidence
        present = step.belief.existence > SHOWN_ABOVE
        self._id += present and not self._present
        self._present = present
        found = [] if step.estimate is None else [_Found(self._id, self.existence, step.estimate)]
        return found, step.diagnostics

    def search_anew(self, dt: float) -> None:
        existence = _mixed(self._filter, self.existence, dt)
        fresh = self._filter.start(self._rng)
        exists = fresh.exists | (self._rng.random(len(fresh.exists)) < existence)
        self._belief = replace(fresh, exists=exists, existence=existence)

    def clouds(self) -> tuple[Belief, ...]:
        return (self._belief,)

    def state(self) -> FilterState:
        return jdt_state.of_one(self._belief, self._id, self._present)

    def restore(self, state: FilterState) -> None:
        self._belief, self._id, self._present = jdt_state.to_one(state, len(self._belief.exists))


class _Several:
    """Several objects."""

    log_evidence = 0.0

    def __init__(self, single: JdtFilter, rng: np.random.Generator, most: int) -> None:
        self._rng, self._most = rng, most
        self.use(single)
        self._belief = self._filter.start(rng)

    @property
    def existence(self) -> float:
        return self._belief.existence

    def use(self, single: JdtFilter) -> None:
        particles = max(single.particles // 2, 25)
        self._filter = MultiJdtFilter(single, most=self._most, track_particles=particles)

    def step(
        self, observation: Observation, appearance: Callable[[], Appearance], dt: float
    ) -> tuple[list[_Found], Diagnostics]:
        step = self._filter.step(self._belief, observation, appearance, dt, self._rng)
        self._belief = step.belief
        self.log_evidence += step.log_evidence
        found = [_Found(track.id, track.belief.existence, track.estimate) for track in step.belief.tracks]
        return found, step.diagnostics

    def search_anew(self, dt: float) -> None:
        existence = _mixed(self._filter.single, self.existence, dt)
        fresh = self._filter.start(self._rng).search
        search = replace(fresh, existence=existence)
        self._belief = MultiBelief((), search, self._belief.next_id)

    def clouds(self) -> tuple[Belief, ...]:
        return (*(track.belief for track in self._belief.tracks), self._belief.search)

    def state(self) -> FilterState:
        return jdt_state.of_several(self._belief)

    def restore(self, state: FilterState) -> None:
        self._belief = jdt_state.to_several(state, len(self._belief.search.exists))


def _mixed(single: JdtFilter, existence: float, dt: float) -> float:
    p_birth, p_death = single.chain.probabilities(dt)
    return (1 - p_death) * existence + p_birth * (1 - existence)


class JdtDetector:
    """Satisfies `lumpwatch.service.detection.detectors.base.Detector`."""

    def __init__(
        self, config: JdtConfig, roi: Roi, learned: Learned | None, maps: Maps | None = None
    ) -> None:
        """`maps` stands for the net that ships. Raises PriorMismatchError."""
        self.roi = roi
        self.learns = True  # nothing, from frame to frame
        self._config = config
        self._likelihood = make_likelihood(config, learned, self.roi, maps)
        self.bodies: NDArray[np.float32] | None = None
        """What each cell of the last picture says of the body that it lies on (rows, columns, VOTES); see
        `lumpwatch.models.likelihood.maps`."""
        self._appearance = HistogramAppearance()
        single, rng = make_filter(config, roi, learned), np.random.default_rng(config.seed)
        self._rng = rng
        self._engine: _Engine = (
            _Several(single, rng, config.objects) if config.several else _Single(single, rng)
        )

    @property
    def log_evidence(self) -> float:
        """Log of how well the filter expected all pictures so far, against pictures without an object."""
        return self._engine.log_evidence

    def use(self, learned: Learned | None) -> None:
        """Take another prior; the belief goes on. Raises PriorMismatchError."""
        # Both are made before either is used: a prior that is refused changes nothing.
        single, likelihood = (
            make_filter(self._config, self.roi, learned),
            make_likelihood(self._config, learned, self.roi),
        )
        self._engine.use(single)
        self._likelihood = likelihood

    def clouds(self) -> tuple[Belief, ...]:
        """All particle clouds after the last step, for overlays and plots."""
        return self._engine.clouds()

    def state(self) -> FilterState:
        """Belief, identities and random generator after the last step."""
        state = self._engine.state()
        return replace(state, plain={**state.plain, "random": self._rng.bit_generator.state})

    def restore(self, state: FilterState) -> None:
        """Go on from there, bit by bit as the filter that exported it. Raises StateMismatchError."""
        self._engine.restore(state)
        jdt_state.set_random(self._rng, state.plain.get("random"))

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        """One working picture (h, w), `dt` seconds after the last."""
        since_s = dt  # what a picture after an outage says is all new
        if dt > LONGEST_STEP_S:
            self._engine.search_anew(dt)
            dt = DEFAULT_INTERVAL_S
        view = self.roi.view(gray, colour)
        observation = self._likelihood.observe(view, since_s)
        self.bodies = observation.votes if isinstance(observation, LumpObservation) else None
        found, summary = self._engine.step(observation, lambda: self._appearance.observe(view), dt)
        objects = tuple(self._describe(estimate) for estimate in found if estimate.existence > SHOWN_ABOVE)
        return Detection(
            self._engine.existence, objects, summary.effective_particles, summary.fell_back_share
        )

    def _describe(self, found: _Found) -> DetectedObject:
        mean, spread = found.estimate.mean, found.estimate.spread / self.roi.scale
        x, y, w, h = (float(v) for v in self.roi.to_frame(mean[None, [X, Y, W, H]])[0])
        names = [model.name for model in self._config.models]
        shares = tuple(zip(names, found.estimate.model_shares.tolist(), strict=True))
        model = names[int(found.estimate.model_shares.argmax())]
        velocity = mean[[VX, VY]] / self.roi.scale
        return DetectedObject(
            found.id,
            x,
            y,
            w,
            h,
            float(spread[X]),
            float(spread[Y]),
            found.existence,
            model,
            shares,
            vx=float(velocity[0]),
            vy=float(velocity[1]),
            spread_w=float(spread[W]),
            spread_h=float(spread[H]),
            spread_v=float(max(spread[VX], spread[VY])),
        )
