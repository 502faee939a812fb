"""What the doors of the public names refuse: arguments of the wrong shape, in words that name them.

All raise ValueError with the argument, what is expected and what was given. They run once a call, not once
a particle.
"""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def check_rng(rng: object, name: str = "rng") -> None:
    """A random generator, where a seed would fail deep in a kernel."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(  # noqa: TRY004  a seed is a value that users try
            f"{name} must be a numpy.random.Generator (numpy.random.default_rng(1)), not {_given(rng)}"
        )


def check_positive(value: object, name: str) -> None:
    """A number that is positive and finite."""
    if not isinstance(value, Real) or not 0.0 < float(value) < float("inf"):
        raise ValueError(f"{name} must be positive and finite, not {value}")


def check_shape(values: Any, shape: tuple[int | str, ...], name: str) -> None:
    """An array of that shape; a side that is a word, such as "n", may be of any length."""
    given: tuple[int, ...] | None = getattr(values, "shape", None)
    fits = given is not None and len(given) == len(shape)
    if not fits or any(
        isinstance(side, int) and side != had for side, had in zip(shape, given or (), strict=True)
    ):
        wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"{name} must be an array of shape {wanted}, not {_given(values)}")


def as_finite(values: ArrayLike, shape: tuple[int | str, ...], name: str) -> NDArray[np.float64]:
    """The numbers as an array of that shape, all finite."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be numbers, not {_given(values)}") from error
    check_shape(array, shape, name)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def as_probabilities(values: ArrayLike, length: int | str, name: str) -> NDArray[np.float64]:
    """The numbers (length,) as an array of probabilities that sum to 1."""
    array = as_finite(values, (length,), name)
    if (array < 0.0).any() or abs(array.sum() - 1.0) > 1e-6:
        raise ValueError(f"{name} must be probabilities that sum to 1, not {array} (sum {array.sum():g})")
    return array


def check_known(value: object, known: tuple[str, ...], name: str) -> None:
    """One of a few words."""
    if value not in known:
        raise ValueError(f"{name} must be {' or '.join(map(repr, known))}, not {value!r}")


def settle(instance: object, values: Mapping[str, object]) -> None:
    """Put checked values in the place of those given, while a frozen data class is made."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def _given(value: object) -> str:
    """What something is, in few words."""
    shape = getattr(value, "shape", None)
    if shape is not None:
        return f"{shape} of {getattr(value, 'dtype', type(value).__name__)}"
    return f"{type(value).__name__} {value!r}"[:80]
