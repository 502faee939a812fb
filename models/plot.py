"""Pictures of what filters and trackers say, drawn into matplotlib axes that the caller made.

    figure, axes = plt.subplots(2, 1)
    plot.existence(axes[0], times, [step.belief.existence for step in steps])
    plot.density(axes[1], times, edges, [plot.share(step.belief, Y, edges) for step in steps])

Nothing here imports matplotlib (the `plot` extra) or opens a window; all lengths are pixels, all times seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lumpwatch.models.checks import check_shape
from lumpwatch.models.jdt.switching import Switching
from lumpwatch.models.roi import Image
from lumpwatch.models.state import SIZE, Belief, States, corners
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]
Axes = Any
"""matplotlib.axes.Axes."""


def existence(
    axes: Axes,
    times: ArrayLike,
    probability: ArrayLike,
    there: tuple[float, float] | None = None,
    **line: Any,
) -> None:
    """P(E = 1) (n,) over times (n,); `there`: from when to when an object is there, shaded.

    Raises ValueError where the two differ in length.
    """
    at = np.asarray(times, dtype=float)
    values = np.asarray(probability, dtype=float)
    check_shape(values, at.shape, "probability")
    if there is not None:
        axes.axvspan(*there, color="0.92", zorder=0)
    axes.plot(at, values, **line)
    axes.set(ylim=(-0.02, 1.02), ylabel="P(E = 1)", xlabel="time (s)")


def share(belief: Belief, component: int, edges: ArrayLike) -> Array:
    """Probability (k,) that an object is there with one component of its state between the `edges` (k + 1,).

    `component` is a column of the state, such as `lumpwatch.models.state.Y`; the sum is the belief's existence but
    for what lies beyond the edges. Raises ValueError for edges that do not rise and a column that is none.
    """
    bounds = np.asarray(edges, dtype=float)
    check_shape(bounds, ("k",), "edges")
    if len(bounds) < 2 or not np.all(np.diff(bounds) > 0.0):
        raise ValueError("edges must be two or more numbers that rise")
    if not 0 <= component < SIZE:
        raise ValueError(f"component must be a column of the state, 0 to {SIZE - 1}, not {component}")
    alive = belief.states[belief.exists, component]
    found, _ = np.histogram(alive, bounds)
    return found * (belief.existence / max(len(alive), 1))


def density(axes: Axes, times: ArrayLike, edges: ArrayLike, shares: ArrayLike, **look: Any) -> Any:
    """Probabilities (n, k) of the cells between `edges` (k + 1,) at times (n,), as a picture; gives the mesh.

    Times are equally far apart; each column is drawn around its own. Rows grow downwards, as in pictures. Raises
    ValueError where the shapes do not fit.
    """
    at, bounds = np.asarray(times, dtype=float), np.asarray(edges, dtype=float)
    values = np.asarray(shares, dtype=float)
    check_shape(values, (len(at), len(bounds) - 1), "shares")
    half = 0.5 * (at[1] - at[0]) if len(at) > 1 else 0.5
    columns = np.append(at - half, at[-1] + half)
    mesh = axes.pcolormesh(columns, bounds, values.T, **{"cmap": "magma_r", "vmin": 0.0, **look})
    axes.set(ylim=(bounds[-1], bounds[0]), xlabel="time (s)", ylabel="px")
    return mesh


def model_shares(axes: Axes, times: ArrayLike, shares: ArrayLike, names: Sequence[str]) -> None:
    """Probabilities (n, M) of the motion models over times (n,), one above the other.

    Raises ValueError where the shapes do not fit.
    """
    at, values = np.asarray(times, dtype=float), np.asarray(shares, dtype=float)
    check_shape(values, (len(at), len(names)), "shares")
    axes.stackplot(at, values.T, labels=names)
    axes.set(ylim=(0.0, 1.0), ylabel="P(model)", xlabel="time (s)")
    axes.legend(loc="upper left")


def switching(
    axes: Axes, law: Switching, states: States, component: int, label: int, dt: float, names: Sequence[str]
) -> None:
    """P(alpha_t | x_{t-1}, alpha_{t-1} = label) (Eq. 10 or 12) over one component of the states (n, 8).

    Raises ValueError where there are not as many names as models.
    """
    rows, _ = law.rows(states, np.full(len(states), label, dtype=np.intp), dt)
    check_shape(rows, (len(states), len(names)), "names, for the models of the law")
    for model, name in enumerate(names):
        axes.plot(states[:, component], rows[:, model], label=name)
    axes.set(ylim=(-0.02, 1.02), ylabel="P(next model)", xlabel="px")
    axes.legend()


def boxes(
    axes: Axes, picture: Image, states: States, texts: Sequence[str] = (), colour: str = "tab:red"
) -> None:
    """The boxes of states (n, 8) over a picture, grey (h, w) or BGR (h, w, 3); `texts`: one above each, or none.

    Raises ValueError for states of another shape or another number of texts.
    """
    check_shape(states, ("n", SIZE), "states")
    if texts and len(texts) != len(states):
        raise ValueError(f"{len(texts)} texts do not fit {len(states)} boxes")
    axes.imshow(picture[..., ::-1] if picture.ndim == 3 else picture, cmap="gray", vmin=0, vmax=255)
    for k, (x, y, w, h) in enumerate(corners(states)):
        axes.plot([x, x + w, x + w, x, x], [y, y, y + h, y + h, y], color=colour, lw=1.5)
        if texts:
            axes.text(x, y - 2, texts[k], color=colour, fontsize=8)
    axes.set(xticks=[], yticks=[], xlim=(-0.5, picture.shape[1] - 0.5), ylim=(picture.shape[0] - 0.5, -0.5))


def paths(axes: Axes, frames: Sequence[Sequence[TrackedObject]], feet: bool = False) -> None:
    """Where the confirmed objects of a tracker went: their centres, or the middle of their boxes' lower edges.

    One line an identity, with the identity at its end; rows grow downwards.
    """
    found: dict[int, list[tuple[float, float]]] = {}
    for objects in frames:
        for one in objects:
            if one.confirmed:
                x, y, _, h = (float(v) for v in one.box)
                found.setdefault(one.id, []).append((x, y + h / 2 if feet else y))
    for identity, places in found.items():
        x, y = np.transpose(places)
        axes.plot(x, y, lw=1.2)
        axes.annotate(str(identity), (x[-1], y[-1]), fontsize=8)
    axes.set(xlabel="x (px)", ylabel="y (px)")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()
