"""The experiment beside the exact posterior: the particles come close, and closer the more there are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reproduction import exact
from tests.reproduction.exact_page import CONTRAST, FORMS, ROWS, SIDE


@pytest.mark.slow
def test_the_page_says_what_was_found(tmp_path: Path) -> None:
    exact.main(tmp_path, numbers=(100, 2000), seeds=3)
    page = (tmp_path / "results" / "exact.md").read_text(encoding="utf-8")
    rows = [
        row.strip("| ").split(" | ")
        for row in page.splitlines()
        if row.startswith(("| marginal", "| sampled"))
    ]
    variation = {(form, number): float(found) for form, number, _, found, _ in rows}
    for form in FORMS:
        assert variation[form, "2,000"] < min(0.4 * variation[form, "100"], 0.05)
    assert all(
        (tmp_path / "images" / name).stat().st_size > 5000 for name in ("exact.png", "exact_errors.png")
    )


def test_the_likelihood_ratio_is_that_of_the_pixels() -> None:
    clip = np.zeros((1, ROWS))
    clip[0, 50:60] = CONTRAST
    ratio = exact.log_ratios(clip)[0]
    assert exact.PLACES[int(ratio.argmax())] == 55.0
    assert ratio.max() == pytest.approx(SIDE * CONTRAST**2 / 2)
    assert ratio[0] == 0.0  # out of sight
