"""A tracker of many objects by joint integrated probabilistic data association.

One step: predict, cut regions that hold several targets, weigh every pair of target and measurement,
associate, update, end and start targets.

Likelihood (paper 3, Eq. 33). With N_ij the Gaussian density of a centre, lambda the density of clutter
and c_ij the colour ratio of `lumpwatch.models.trackers.jpda.colour`, the pair has

    L_ij = lambda (N_ij / lambda)^a c_ij^b:

both factors are ratios against clutter, so whatever the exponents L is a density that compares with
lambda. It is zero outside the gate.

Existence (Musicki, Evans 2004, "Joint integrated probabilistic data association"). A target exists with
probability psi, a Markov chain of mean lifetime T: psi <- psi exp(-dt / T). Marginals are those of a
target that is detected with P_D psi; afterwards, with G = P_D P_G,

    psi <- (1 - G) psi / (1 - G psi) beta_0 + sum of beta_j,

and the state is updated by the same terms divided by the new psi.

Births and deaths follow paper 3, section IV-B (Eq. 30), in seconds instead of frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import check_positive
from lumpwatch.models.trackers.jpda import colour
from lumpwatch.models.trackers.jpda.association import Association, associate, associate_star
from lumpwatch.models.trackers.jpda.edges import centres, cut_by_edge
from lumpwatch.models.trackers.jpda.kalman import STATE, Gaussians, Innovations, innovations, predict, update
from lumpwatch.models.trackers.jpda.options import JpdaOptions
from lumpwatch.models.trackers.jpda.splitting import split
from lumpwatch.models.trackers.jpda.zones import Heading, follow, inside
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]
_ROUNDING_S = 1e-9


class Associator(Protocol):
    """How measurements are given to targets; `lumpwatch.models.trackers.jpda.association.associate` is one."""

    def __call__(
        self, likelihood: Array, detection: Array, clutter: float, gate_probability: float, exact: int
    ) -> Association:
        """The weights of all pairs."""


_ASSOCIATORS: dict[str, Associator] = {"jpda": associate, "jpda_star": associate_star}


@dataclass(frozen=True, slots=True)
class _Target:
    """What is known of a target beside its state."""

    id: int
    width: float
    height: float
    existence: float
    appearance: Array | None
    """Colour histograms as last seen, None where no picture was given."""
    heading: Heading
    seen_s: float = 0.0
    missed_s: float = 0.0
    unseen_s: float = 0.0
    """Time since it was last seen, covered by another region or not."""
    misses: int = 0
    shared_s: float = 0.0
    confirmed: bool = False


class JpdaTracker:
    """Tracks boxes that a detector finds in pictures of one size; deterministic."""

    def __init__(
        self, options: JpdaOptions, shape: tuple[int, int], associator: Associator | None = None
    ) -> None:
        """`shape` is height and width of the pictures; an `associator` takes the place of `options.association`.

        Raises ValueError where height or width is not positive.
        """
        if min(shape) < 1:
            raise ValueError(f"the picture must have a height and a width, not {shape}")
        self._options = options
        self._shape = shape
        self._associate = associator or _ASSOCIATORS[options.association]
        self._density = options.clutter / (shape[0] * shape[1])
        self._gate_probability = 1.0 - float(np.exp(-0.5 * options.gate_sigma**2))
        self._noise = np.eye(2) * options.noise_px**2
        self._states = Gaussians(np.zeros((0, STATE)), np.zeros((0, STATE, STATE)))
        self._targets: list[_Target] = []
        self._next_id = 1
        self.approximated = 0
        """Steps in which a cluster was too large for the exact or the pruned sum."""

    def step(
        self, boxes: Array, dt: float, picture: NDArray[np.uint8] | None = None
    ) -> tuple[TrackedObject, ...]:
        """All targets, oldest first, after a picture with `boxes` (n, 4), `dt` seconds after the last.

        A box is centre x, y, width, height. Raises ValueError for boxes that are not finite or have no
        size, a dt that is not positive and finite, and a picture of another shape; the tracker then is
        as before.
        """
        boxes = self._checked(boxes, dt, picture)
        options = self._options
        states = predict(self._states, options.model, dt)
        if options.split:
            sure = [i for i, target in enumerate(self._targets) if target.confirmed]
            boxes = split(boxes, np.hstack([states.mean[sure, :2], self._sizes()[sure]]))
        histograms = None
        if picture is not None and options.colour.weight > 0.0:
            histograms = colour.histograms(picture, boxes, options.colour.bins)

        seen = innovations(states, centres(boxes, self._sizes(), self._shape), self._noise)
        prior = self._existence() * np.exp(-dt / options.lifetime_s)
        found = self._associate(
            self._likelihood(seen, histograms),
            options.detection * prior,
            self._density,
            self._gate_probability,
            options.exact,
        )
        self.approximated += bool(found.approximate.any())
        existence, beta = self._integrated(prior, found.beta)
        self._states = update(states, seen, beta, self._noise)
        self._targets = [
            self._followed(
                i,
                target,
                existence=existence[i],
                beta=beta[i],
                boxes=boxes,
                histograms=histograms,
                dt=dt,
            )
            for i, target in enumerate(self._targets)
        ]
        self._end(beta, dt)
        self._start(boxes, histograms, 1.0 - found.beta[:, 1:].sum(axis=0))
        return self._objects()

    def _checked(self, boxes: Array, dt: float, picture: NDArray[np.uint8] | None) -> Array:
        boxes = np.asarray(boxes, dtype=float)
        if boxes.ndim != 2 or boxes.shape[1] != 4:
            raise ValueError(f"boxes must be (n, 4), not {boxes.shape}")
        if not np.all(np.isfinite(boxes)) or np.any(boxes[:, 2:] <= 0.0):
            raise ValueError("boxes must be finite and have a width and a height")
        check_positive(dt, "dt")
        if picture is not None and picture.shape[:2] != self._shape:
            raise ValueError(f"the picture must be {self._shape}, not {picture.shape}")
        return boxes

    def _likelihood(self, seen: Innovations, histograms: Array | None) -> Array:
        """L_ij (n, m)."""
        options = self._options
        ratio = (seen.density / self._density) ** options.space_weight
        known = [i for i, target in enumerate(self._targets) if target.appearance is not None]
        if histograms is not None and len(histograms) and known:
            references = np.stack([known_as for t in self._targets if (known_as := t.appearance) is not None])
            by_colour = colour.ratio(references, histograms, options.colour.kappa, options.colour.neutral)
            ratio[known] *= by_colour**options.colour.weight
        return np.where(seen.distance <= options.gate_sigma**2, self._density * ratio, 0.0)

    def _integrated(self, prior: Array, beta: Array) -> tuple[Array, Array]:
        """Existence (n,) and the association probabilities given existence (n, m + 1)."""
        detected = self._options.detection * self._gate_probability
        given = beta.copy()
        given[:, 0] *= (1.0 - detected) * prior / (1.0 - detected * prior)
        existence = np.maximum(given.sum(axis=1), np.finfo(float).tiny)
        return np.minimum(existence, 1.0), given / existence[:, None]

    def _followed(
        self,
        i: int,
        target: _Target,
        *,
        existence: float,
        beta: Array,
        boxes: Array,
        histograms: Array | None,
        dt: float,
    ) -> _Target:
        """The target after the update of its state."""
        options, mean = self._options, self._states.mean[i]
        reach = np.abs(boxes[:, :2] - mean[:2])
        covered = bool(np.any(np.all(reach <= 0.5 * boxes[:, 2:], axis=1)))
        if beta[0] >= 0.5:
            waited = target.missed_s if covered else target.missed_s + dt
            return replace(
                target,
                existence=float(existence),
                missed_s=waited,
                unseen_s=target.unseen_s + dt,
                misses=target.misses if covered else target.misses + 1,
            )
        best = int(beta[1:].argmax())
        size = self._size(target, boxes, beta[1:] / beta[1:].sum(), dt)
        seen_s = target.seen_s + dt
        heading = target.heading
        if options.one_way is not None:
            heading = follow(heading, mean[0], mean[1], target.unseen_s + dt, options.one_way)
        sure = existence >= options.confirm_above and seen_s >= options.confirm_s - _ROUNDING_S
        return replace(
            target,
            width=float(size[0]),
            height=float(size[1]),
            existence=float(existence),
            appearance=target.appearance if histograms is None or beta[1 + best] < 0.5 else histograms[best],
            heading=heading,
            seen_s=seen_s,
            missed_s=0.0,
            unseen_s=0.0,
            misses=0,
            confirmed=bool(target.confirmed or sure),
        )

    def _size(self, target: _Target, boxes: Array, weights: Array, dt: float) -> Array:
        """Width and height follow the measured ones; where the edge cuts a box they can but grow."""
        size = np.array([target.width, target.height])
        measured = weights @ boxes[:, 2:]
        follow = size + (1.0 - float(np.exp(-dt / self._options.size_s))) * (measured - size)
        low, high = cut_by_edge(boxes, self._shape)
        return np.where(weights @ (low | high) > 0.5, np.maximum(size, measured), follow)

    def _end(self, beta: Array, dt: float) -> None:
        """Drop targets that have left, were not seen for long, or are the same object as an older one."""
        options = self._options
        self._share(beta, dt)
        picture = np.array(self._shape[::-1], dtype=float)
        centre, velocity = self._states.mean[:, :2], self._states.mean[:, 2:4]
        ahead = centre + options.missed_s * velocity
        leaves = inside(centre, options.exits) | np.any((ahead < 0.0) | (ahead > picture), axis=1)
        gone = np.any(np.abs(centre - 0.5 * picture) >= 0.5 * (self._sizes() + picture), axis=1)
        kept = []
        for i, target in enumerate(self._targets):
            ends = (
                target.existence < options.end_below
                or (target.misses > 1 and target.missed_s > options.missed_s + _ROUNDING_S)
                or (target.misses > 0 and leaves[i])
                or gone[i]
                or target.shared_s > (options.shared_s if target.confirmed else 0.0)
            )
            if not ends:
                kept.append(i)
        self._targets = [self._targets[i] for i in kept]
        self._states = Gaussians(self._states.mean[kept], self._states.covariance[kept])

    def _share(self, beta: Array, dt: float) -> None:
        """Count for how long a target has lain on an older one and lived on the same measurement."""
        if beta.shape[1] < 2 or len(self._targets) < 2:
            return
        best = beta[:, 1:].argmax(axis=1)
        fed = beta[np.arange(len(beta)), 1 + best] > 0.1
        where, sides = self._states.mean[:, :2], self._sizes().mean(axis=1)
        for i in range(1, len(self._targets)):
            apart = np.hypot(*(where[:i] - where[i]).T)
            same = bool(np.any(fed[i] & fed[:i] & (best[:i] == best[i]) & (apart < 0.5 * sides[:i])))
            shared = self._targets[i].shared_s + dt if same else 0.0
            self._targets[i] = replace(self._targets[i], shared_s=shared)

    def _start(self, boxes: Array, histograms: Array | None, unexplained: Array) -> None:
        """Start a target at each measurement that no target explains and that is far from all (Eq. 30)."""
        options = self._options
        apart = np.hypot(*(boxes[:, None, :2] - self._states.mean[None, :, :2]).T).T
        free = (unexplained > 0.5) & np.all(apart > options.birth_apart * self._sizes().mean(axis=1), axis=1)
        if options.entries:
            free &= inside(boxes[:, :2], options.entries)
        born = np.flatnonzero(free)[: options.most - len(self._targets)]
        mean, covariance = np.zeros((len(born), STATE)), np.zeros((len(born), STATE, STATE))
        mean[:, :2] = boxes[born, :2]
        speed, rate = options.birth_speed**2, options.birth_acceleration**2
        covariance[:] = np.diag([*np.diag(self._noise), speed, speed, rate, rate])
        for j in born:
            x, y, width, height = (float(c) for c in boxes[j])
            appearance = None if histograms is None else histograms[j]
            self._targets.append(
                _Target(self._next_id, width, height, options.birth_existence, appearance, Heading(x, y))
            )
            self._next_id += 1
        self._states = Gaussians(
            np.concatenate([self._states.mean, mean]),
            np.concatenate([self._states.covariance, covariance]),
        )

    def _sizes(self) -> Array:
        return np.array([(t.width, t.height) for t in self._targets]).reshape(-1, 2)

    def _existence(self) -> Array:
        return np.array([target.existence for target in self._targets])

    def _objects(self) -> tuple[TrackedObject, ...]:
        spread = np.sqrt(np.diagonal(self._states.covariance, axis1=1, axis2=2)[:, :2])
        return tuple(
            TrackedObject(
                id=target.id,
                box=np.array([*self._states.mean[i, :2], target.width, target.height]),
                velocity=self._states.mean[i, 2:4].copy(),
                spread=spread[i].copy(),
                existence=target.existence,
                confirmed=target.confirmed,
                wrong_way=target.confirmed and target.heading.wrong,
            )
            for i, target in enumerate(self._targets)
        )
