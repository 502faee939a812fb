"""The examples of docs/models.md run as they are printed, one after the other, and show what they are to show."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "models.md"


@pytest.fixture(scope="module")
def ran() -> dict[str, Any]:
    """The names that the page's Python blocks leave behind."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    assert len(blocks) >= 4
    names: dict[str, Any] = {"__name__": "example"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{PAGE.name}, block {number}", "exec", dont_inherit=True), names)
    return names


def test_the_first_example_finds_its_square(ran: dict[str, Any]) -> None:
    assert ran["belief"].existence > 0.9
    assert ran["step"].estimate.mean[:2] == pytest.approx([162.5, 142.5], abs=3.0)
    assert ran["log_evidence"] > 5.0


def test_the_likelihood_of_ones_own_finds_it_too(ran: dict[str, Any]) -> None:
    last = ran["steps"][-1]
    assert last.belief.existence > 0.9
    assert last.estimate.mean[:2] == pytest.approx([162.5, 142.5], abs=6.0)


def test_the_motion_model_of_ones_own_slows_down(ran: dict[str, Any]) -> None:
    states = np.zeros((3, 8))
    states[:, 2] = 10.0
    moved = ran["Sliding"]("slide", 100.0, jitter_h=0.0).move(states, 1.0, np.random.default_rng(1))
    assert moved[:, 2] == pytest.approx(10.0 * np.exp(-1.0))
    assert moved[:, 0] == pytest.approx(10.0 * (1.0 - np.exp(-1.0)))
