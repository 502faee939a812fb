"""The matrix of difficulty, and the page about the simulated feed."""

from __future__ import annotations

from itertools import combinations

import pytest

from lumpwatch.service.simulator.spec import FeedSpec
from tests.reproduction.matrix import STANDARD, scene, scenes
from tests.reproduction.simulator import DOCS, page


def test_names_are_unique_and_find_their_scene() -> None:
    names = [one.name for one in scenes()]
    assert len(names) == len(set(names)) >= 50
    assert names[0] == "standard"
    assert scene("standard").spec == STANDARD
    assert scene("b-night-0.7").spec.style == "b"
    with pytest.raises(KeyError):
        scene("moonlight")


def test_train_and_test_seeds_never_mix() -> None:
    one = scene("dust-1")
    parts = [
        {spec.seed for spec in part()} for part in (one.train, one.test, one.train_empty, one.test_empty)
    ]
    assert all(parts)
    assert all(not a & b for a, b in combinations(parts, 2))
    assert len(parts[1]) == 20


def test_scenes_are_valid_specs_and_the_empty_ones_have_no_lumps() -> None:
    for one in scenes():
        assert FeedSpec.model_validate(one.spec.model_dump()) == one.spec
        assert all(spec.lumps_per_minute > 0 for spec in one.test())
        assert all(spec.lumps_per_minute == 0 for spec in one.test_empty())
        assert all(spec.model_copy(update={"seed": 0}) == one.spec for spec in one.train())


def test_the_matrix_has_what_was_asked_for() -> None:
    specs = [one.spec for one in scenes()]
    for key, low, high in (
        ("smallest_lump", 0.7, 2.0), ("fps", 5, 30), ("dust", 0, 1), ("night", 0, 1), ("lump_contrast", 0.15, 1),
        ("rain", 0, 1), ("exposure_jump", 1, 4), ("shake_px", 0.5, 10), ("stop_every_s", 0, 15),
    ):  # fmt: skip
        values = [getattr(spec, key) for spec in specs]
        assert (min(values), max(values)) == (low, high)
    assert {spec.h264_crf for spec in specs} >= {None, 30, 42}


def test_the_page_is_that_of_todays_options() -> None:
    text = (DOCS / "simulator.md").read_text(encoding="utf-8")
    assert text == page(), "run python -m tests.reproduction.simulator"
    assert (DOCS / "images" / "simulator.png").stat().st_size > 100_000
