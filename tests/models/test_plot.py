"""The pictures show what they are given."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from lumpwatch.models import Belief, FixedSwitching, TrackedObject, blank, plot
from lumpwatch.models.state import H, W, X, Y


def axes() -> Any:
    return Figure().subplots()


def belief(existence: float = 0.8) -> Belief:
    """Four particles at rows 1, 1, 5 and 9, of which the last is not alive."""
    states = blank(4)
    states[:, Y] = 1.0, 1.0, 5.0, 9.0
    return Belief(states, np.zeros(4, np.intp), np.array([True, True, True, False]), existence)


def test_shares_sum_to_the_existence() -> None:
    found = plot.share(belief(0.9), Y, [0.0, 2.0, 6.0, 10.0])
    assert found == pytest.approx([0.6, 0.3, 0.0])


def test_what_nobody_believes_has_no_share() -> None:
    dead = Belief(blank(3), np.zeros(3, np.intp), np.zeros(3, np.bool_), 0.0)
    assert plot.share(dead, Y, [0.0, 1.0]).tolist() == [0.0]


def test_a_density_stands_at_its_times_and_cells() -> None:
    drawn = axes()
    mesh = plot.density(drawn, [0.0, 0.5], [10.0, 20.0, 40.0], [[0.1, 0.2], [0.3, 0.4]])
    assert np.ma.getdata(mesh.get_array()).ravel() == pytest.approx([0.1, 0.3, 0.2, 0.4])
    corners = np.asarray(mesh.get_coordinates())
    assert corners[0, :, 0].tolist() == pytest.approx([-0.25, 0.25, 0.75])
    assert corners[:, 0, 1].tolist() == pytest.approx([10.0, 20.0, 40.0])
    assert drawn.get_ylim() == (40.0, 10.0)


def test_existence_is_a_line_over_the_time_that_something_is_there() -> None:
    drawn = axes()
    plot.existence(drawn, [0.0, 1.0], [0.2, 0.9], there=(0.5, 1.0), label="one")
    assert drawn.lines[0].get_xydata() == pytest.approx(np.array([[0.0, 0.2], [1.0, 0.9]]))
    assert drawn.patches[0].get_x() == pytest.approx(0.5)


def test_model_shares_are_stacked() -> None:
    drawn = axes()
    plot.model_shares(drawn, [0.0, 1.0], [[0.3, 0.7], [0.6, 0.4]], ("slow", "fast"))
    tops = [one.get_paths()[0].vertices[:, 1].max() for one in drawn.collections]
    assert tops == pytest.approx([0.6, 1.0])


def test_switching_is_drawn_for_the_model_before() -> None:
    drawn, states = axes(), blank(3)
    states[:, X] = 0.0, 1.0, 2.0
    law = FixedSwitching(np.array([[0.9, 0.1], [0.4, 0.6]]), 0.1, np.zeros(2, np.bool_))
    plot.switching(drawn, law, states, X, 1, 0.1, ("a", "b"))
    assert [line.get_ydata()[0] for line in drawn.lines] == pytest.approx([0.4, 0.6])


def test_boxes_lie_where_the_states_are() -> None:
    drawn, states = axes(), blank(1)
    states[0, [X, Y, W, H]] = 10.0, 20.0, 4.0, 6.0
    plot.boxes(drawn, np.zeros((30, 40, 3), np.uint8), states, ["a"])
    outline = np.asarray(drawn.lines[0].get_xydata())
    assert outline.min(axis=0).tolist() == [8.0, 17.0]
    assert outline.max(axis=0).tolist() == [12.0, 23.0]
    assert drawn.texts[0].get_text() == "a"


def test_paths_join_the_places_of_an_identity() -> None:
    def at(x: float, confirmed: bool = True) -> TrackedObject:
        return TrackedObject(
            id=3,
            box=np.array([x, 5.0, 2.0, 4.0]),
            velocity=np.zeros(2),
            spread=np.zeros(2),
            existence=0.9,
            confirmed=confirmed,
            model_shares=np.ones(1),
        )

    drawn = axes()
    plot.paths(drawn, [[at(0.0, confirmed=False)], [at(1.0)], [], [at(3.0)]], feet=True)
    assert np.asarray(drawn.lines[0].get_xydata()).tolist() == [[1.0, 7.0], [3.0, 7.0]]
    assert drawn.yaxis_inverted()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: plot.existence(axes(), [0.0, 1.0], [0.5]), "probability"),
        (lambda: plot.density(axes(), [0.0], [0.0, 1.0], [[0.1, 0.2]]), "shares"),
        (lambda: plot.share(belief(), Y, [1.0, 1.0]), "edges"),
        (lambda: plot.share(belief(), 8, [0.0, 1.0]), "component"),
        (lambda: plot.model_shares(axes(), [0.0], [[0.5, 0.5]], ("one",)), "shares"),
        (lambda: plot.boxes(axes(), np.zeros((9, 9), np.uint8), blank(2), ["one"]), "texts"),
    ],
)
def test_what_does_not_fit_is_named(call: object, says: str) -> None:
    assert callable(call)
    with pytest.raises(ValueError, match=says):
        call()


def test_importing_it_needs_no_matplotlib() -> None:
    code = "import sys; import lumpwatch.models.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
