"""Several objects: a multi-Bernoulli filter on images, with one JDT filter an object.

The belief is a union of independent Bernoulli components, each with an existence and a particle
cloud of its own (Vo, Vo, Pham, Suter 2010: for objects whose pictures do not overlap, and a
likelihood that factorises over them, the update of such a union is exact and goes component by
component). Existing objects are *tracks*; one further component *searches* for the next:

- The search gives no credit to boxes that a track explains, so no object is counted twice, and its
  births do not compete with an object that is already tracked: a track takes no part in them.
- When the search is more likely than not to have found something, it becomes a track with a new
  identity and a fresh search begins.
- Where a track's box lies over another track's, what is seen there may be either: its particles get no
  credit for it, and it goes on by its motion. After a crossing each cloud finds its own
  object by its appearance, a description that is taken once there are two tracks, and slowly renewed while
  nothing covers it.
- A track ends when its existence is small, or when it has lain on an older track for a while.

The paper leaves M_e > 1 to its reference [16] (Czyz et al.), where one particle carries the joint
state of all objects; the number of particles needed grows exponentially there, and linearly here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Diagnostics, JdtFilter
from lumpwatch.models.likelihood.base import Likelihood, Observation, look
from lumpwatch.models.roi import Image, Roi, View
from lumpwatch.models.state import Belief, Estimate, H, States, W, X, Y

_NEVER = 1e-12  # birth rate of a track: it is one object, and no other can take its place


class Appearance(Protocol):
    """One picture, ready to tell objects from one another."""

    def describe(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the box of a state (8,) looks like, as a vector."""

    def distance(self, states: States, description: NDArray[np.float64]) -> NDArray[np.float64]:
        """How unlike a description the boxes of the states (n, 8) are, (n,) from 0 to 1."""


@dataclass(frozen=True, slots=True)
class Track:
    """One object."""

    id: int
    belief: Belief
    estimate: Estimate
    description: NDArray[np.float64] | None
    """What it looks like; None while it is alone or not known."""
    hidden_s: float = 0.0
    """How long it has lain on an older track without a break."""


@dataclass(frozen=True, slots=True)
class MultiBelief:
    """All tracks, oldest first, and the search for the next."""

    tracks: tuple[Track, ...]
    search: Belief
    next_id: int = 1

    @property
    def existence(self) -> float:
        """P(at least one object exists)."""
        absent = 1.0 - self.search.existence
        for track in self.tracks:
            absent *= 1.0 - track.belief.existence
        return 1.0 - absent


@dataclass(frozen=True, slots=True)
class MultiStep:
    """Result of one step."""

    belief: MultiBelief
    diagnostics: Diagnostics
    """Those of the oldest track, or of the search where there is none."""
    log_evidence: float
    """The sum over all tracks and the search: that of the union, as far as their pictures do not overlap."""


@dataclass(frozen=True, slots=True)
class MultiJdtFilter:
    """Fixed parts; the changing part is the `MultiBelief` that goes through `step`."""

    single: JdtFilter
    """The filter of the search, in the marginal form."""
    most: int = 4
    """Largest number of tracks."""
    track_particles: int = 1000
    found_above: float = 0.5
    """Existence from which the search has found an object."""
    lost_below: float = 0.05
    """Existence under which a track ends."""
    apart: float = 0.1
    """Share of a box that may lie on a track's before the search leaves it to the track."""
    overlap: float = 0.3
    """Share of a box that may lie on another track's before it counts as covered."""
    hidden_for_s: float = 1.0
    """A track that has lain on an older one for longer is the same object."""
    distinction: float = 8.0
    """Log likelihood that a box loses when it looks wholly unlike its track."""
    renewal_per_s: float = 0.2
    """Rate at which a track's description follows its appearance."""

    def __post_init__(self) -> None:
        """Raises ValueError where existence is not computed from the weights, or without tracks or particles."""
        if self.most < 1 or self.track_particles < 1:
            raise ValueError(
                f"most and track_particles must be 1 or more, not {self.most} and {self.track_particles}"
            )
        if self.single.form != "marginal":
            raise ValueError("several objects need the marginal form")

    def start(self, rng: np.random.Generator) -> MultiBelief:
        """No object yet."""
        return MultiBelief((), self.single.start(rng))

    def step(
        self,
        belief: MultiBelief,
        observation: Observation,
        appearance: Callable[[], Appearance] | None,
        dt: float,
        rng: np.random.Generator,
    ) -> MultiStep:
        """One frame, `dt` seconds after the last; `appearance` is called where there are two tracks or more.

        Raises ValueError as `JdtFilter.step` does.
        """
        appearances = appearance() if appearance is not None and len(belief.tracks) > 1 else None
        follower = self._follower()
        diagnostics = None
        log_evidence = 0.0
        tracks: list[Track] = []
        boxes = [_predicted(track, dt) for track in belief.tracks]
        for i, track in enumerate(belief.tracks):
            others = np.array(boxes[:i] + boxes[i + 1 :]).reshape(-1, 8)
            seen = _Uncovered(observation, appearances, track.description, others, self)
            step = follower.step(track.belief, seen, dt, rng)
            log_evidence += step.log_evidence
            if step.estimate is None or step.belief.existence < self.lost_below:
                continue
            diagnostics = diagnostics or step.diagnostics
            boxes[i] = step.estimate.mean
            tracks.append(replace(track, belief=step.belief, estimate=step.estimate))
        tracks = self._settle(tracks, appearances, dt)

        unexplained = _Unexplained(observation, _boxes(tracks), self.apart)
        step = self.single.step(belief.search, unexplained, dt, rng)
        log_evidence += step.log_evidence
        search, next_id = step.belief, belief.next_id
        found = step.estimate is not None and search.existence > self.found_above
        if found and len(tracks) < self.most and step.estimate is not None:
            tracks.append(self._promote(search, step.estimate, next_id, rng))
            search, next_id = self.single.start(rng), next_id + 1
        after = MultiBelief(tuple(tracks), search, next_id)
        return MultiStep(after, diagnostics or step.diagnostics, log_evidence)

    def run(
        self,
        pictures: Iterable[Image],
        roi: Roi,
        likelihood: Likelihood,
        dt: float,
        rng: np.random.Generator,
        *,
        appearance: Callable[[View], Appearance] | None = None,
        belief: MultiBelief | None = None,
    ) -> Iterator[MultiStep]:
        """As `JdtFilter.run`; `appearance` looks at a view, such as `HistogramAppearance().observe`."""
        belief = self.start(rng) if belief is None else belief
        for view, observation in look(pictures, roi, likelihood, dt):
            of_view = None if appearance is None else partial(appearance, view)
            step = self.step(belief, observation, of_view, dt, rng)
            belief = step.belief
            yield step

    def _follower(self) -> JdtFilter:
        """The filter of a track: no births, fewer particles."""
        chain = ExistenceChain(_NEVER, self.single.chain.death_rate)
        return replace(self.single, chain=chain, born_share=0.0, particles=self.track_particles + 1)

    def _promote(self, found: Belief, estimate: Estimate, track_id: int, rng: np.random.Generator) -> Track:
        """The part of the search's cloud that lies on the estimate as a new track.

        The search may have found two objects at once; the other is found again.
        """
        near = np.flatnonzero(_covered(found.states, estimate.mean[None]) > self.overlap)
        near = near if len(near) else np.arange(len(found.states))
        chosen = near[rng.integers(len(near), size=self.track_particles)]
        cloud = Belief(found.states[chosen], found.labels[chosen], found.exists[chosen], found.existence)
        return Track(track_id, cloud, estimate, None)

    def _settle(self, tracks: list[Track], appearance: Appearance | None, dt: float) -> list[Track]:
        """Renew what uncovered tracks look like; end those that have become one with an older track."""
        settled: list[Track] = []
        for i, track in enumerate(tracks):
            box = track.estimate.mean[None]
            older = _covered(box, _boxes(settled))[0]
            younger = _covered(box, _boxes(tracks[i + 1 :]))[0]
            hidden_s = track.hidden_s + dt if older > self.overlap else 0.0
            if hidden_s > self.hidden_for_s:
                continue
            description = track.description
            if appearance is not None and max(older, younger) < 0.5 * self.overlap:
                now = appearance.describe(track.estimate.mean)
                rate = min(1.0, self.renewal_per_s * dt)
                description = now if description is None else (1 - rate) * description + rate * now
            settled.append(replace(track, hidden_s=hidden_s, description=description))
        return settled


@dataclass(frozen=True, slots=True)
class _Unexplained:
    """The picture without the objects that are already tracked, for the search."""

    observation: Observation
    explained: States
    apart: float

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        ratio = self.observation.log_ratio(states)
        taken = _covered(states, self.explained) > self.apart
        return np.where(taken, np.minimum(ratio, 0.0) - 1.0, ratio)


@dataclass(frozen=True, slots=True)
class _Uncovered:
    """The picture as one track sees it: its own appearance counts, and nothing where another track lies."""

    observation: Observation
    appearance: Appearance | None
    description: NDArray[np.float64] | None
    others: States
    settings: MultiJdtFilter

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        ratio = self.observation.log_ratio(states)
        covered = _covered(states, self.others) > self.settings.overlap
        hidden = np.minimum(ratio, 0.0)  # where nothing is seen, none of them is there
        if self.appearance is not None and self.description is not None and len(self.others):
            ratio = ratio - self.settings.distinction * self.appearance.distance(states, self.description)
        return np.where(covered, hidden, ratio)


def _predicted(track: Track, dt: float) -> NDArray[np.float64]:
    """Where a track's estimate will be, by its velocity."""
    box = track.estimate.mean.copy()
    box[X : Y + 1] += dt * box[2:4]
    return box


def _boxes(tracks: list[Track]) -> States:
    return np.array([track.estimate.mean for track in tracks]).reshape(-1, 8)


def _covered(states: States, others: States) -> NDArray[np.float64]:
    """The largest share of each state's box, or of the other box if that is smaller, that they have in common."""
    return _largest_share(states, others)


@njit(cache=True)
def _largest_share(states, others):  # type: ignore[no-untyped-def]
    out = np.zeros(len(states))
    for i in range(len(states)):
        x, y, w, h = states[i, X], states[i, Y], states[i, W], states[i, H]
        for k in range(len(others)):
            across = min(x + w / 2, others[k, X] + others[k, W] / 2) - max(
                x - w / 2, others[k, X] - others[k, W] / 2
            )
            down = min(y + h / 2, others[k, Y] + others[k, H] / 2) - max(
                y - h / 2, others[k, Y] - others[k, H] / 2
            )
            if across > 0.0 and down > 0.0:
                smaller = min(w * h, others[k, W] * others[k, H])
                out[i] = max(out[i], across * down / max(smaller, 1e-9))
    return out
