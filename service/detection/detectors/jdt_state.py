"""The beliefs of the JDT filter as plain data and back, bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.multi_object import MultiBelief, Track
from lumpwatch.models.state import SIZE, Belief, Estimate
from lumpwatch.service.detection.detectors.base import FilterState, StateMismatchError

_Arrays = dict[str, NDArray[Any]]


def of_one(belief: Belief, last_id: int, present: bool) -> FilterState:
    """The state of the filter for one object."""
    return FilterState({"engine": "one", "id": last_id, "present": present}, _of_belief("belief", belief))


def to_one(state: FilterState, particles: int) -> tuple[Belief, int, bool]:
    """The reverse of `of_one`. Raises StateMismatchError."""
    _check_engine(state, "one")
    try:
        plain = state.plain
        return _to_belief(state.arrays, "belief", particles), int(plain["id"]), bool(plain["present"])
    except (KeyError, TypeError, ValueError) as error:
        raise StateMismatchError(f"the filter state is not as expected ({error})") from error


def of_several(belief: MultiBelief) -> FilterState:
    """The state of the filter for several objects."""
    arrays = _of_belief("search", belief.search)
    tracks = []
    for k, track in enumerate(belief.tracks):
        tracks.append({"id": track.id, "hidden_s": track.hidden_s})
        estimate = track.estimate
        arrays |= _of_belief(f"track{k}", track.belief)
        arrays |= {
            f"track{k}.mean": estimate.mean.copy(),
            f"track{k}.spread": estimate.spread.copy(),
            f"track{k}.model_shares": estimate.model_shares.copy(),
        }
        if track.description is not None:
            arrays[f"track{k}.description"] = track.description.copy()
    return FilterState({"engine": "several", "next_id": belief.next_id, "tracks": tracks}, arrays)


def to_several(state: FilterState, particles: int) -> MultiBelief:
    """The reverse of `of_several`; `particles` are those of the search. Raises StateMismatchError."""
    _check_engine(state, "several")
    arrays = state.arrays
    try:
        tracks = tuple(
            Track(
                int(track["id"]),
                _to_belief(arrays, f"track{k}"),
                Estimate(
                    arrays[f"track{k}.mean"], arrays[f"track{k}.spread"], arrays[f"track{k}.model_shares"]
                ),
                arrays.get(f"track{k}.description"),
                float(track["hidden_s"]),
            )
            for k, track in enumerate(state.plain["tracks"])
        )
        return MultiBelief(tracks, _to_belief(arrays, "search", particles), int(state.plain["next_id"]))
    except (KeyError, TypeError, ValueError) as error:
        raise StateMismatchError(f"the filter state is not as expected ({error})") from error


def set_random(rng: np.random.Generator, state: Any) -> None:
    """Set a generator. Raises StateMismatchError."""
    try:
        rng.bit_generator.state = state
    except (KeyError, TypeError, ValueError) as error:
        raise StateMismatchError(f"the state of the random generator is not as expected ({error})") from error


def _check_engine(state: FilterState, wanted: str) -> None:
    if state.plain.get("engine") != wanted:
        raise StateMismatchError(f"the filter state is of '{state.plain.get('engine')}', expected '{wanted}'")


def _of_belief(name: str, belief: Belief) -> _Arrays:
    return {
        f"{name}.states": belief.states.copy(),
        f"{name}.labels": belief.labels.copy(),
        f"{name}.exists": belief.exists.copy(),
        f"{name}.existence": np.array(belief.existence, dtype=np.float64),
    }


def _to_belief(arrays: _Arrays, name: str, particles: int | None = None) -> Belief:
    states, labels, exists = (arrays[f"{name}.{part}"] for part in ("states", "labels", "exists"))
    n = len(exists) if particles is None else particles
    if states.shape != (n, SIZE) or labels.shape != (n,) or exists.shape != (n,):
        raise ValueError(f"{name} has {len(states)} particles, expected {n}")
    return Belief(states, labels, exists, float(arrays[f"{name}.existence"]))
