"""A trained prior is stored, judged and only then used; what it learned from is known to the next refinement."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lumpwatch.service.storage import Prior, PriorStore
from lumpwatch.service.training import accept, missing_sources, objection_to, sources_text
from lumpwatch.service.training.cross_validation import HeldOut, Judged, Validation
from lumpwatch.service.training.dataset import Lump
from tests.service_helpers import prior

OF = ("cam", "apron")


@pytest.fixture
def store(tmp_path: Path) -> PriorStore:
    """One version is in use."""
    made = PriorStore(tmp_path)
    made.save(prior(source="old"))
    return made


def in_use(store: PriorStore) -> str | None:
    found = store.current(*OF).prior
    return None if found is None else found.meta.source


def test_it_is_used_once_it_was_judged(store: PriorStore) -> None:
    seen: list[tuple[int, str | None]] = []

    def judge(stored: Prior) -> None:
        seen.append((stored.version, in_use(store)))

    acceptance = accept(store, prior(source="new"), judge)
    assert seen == [(2, "old")]
    assert (acceptance.prior.version, acceptance.objection) == (2, None)
    assert in_use(store) == "new"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError, SystemExit])
def test_what_is_interrupted_leaves_the_old_one_in_use(store: PriorStore, stop: type[BaseException]) -> None:
    def judge(stored: Prior) -> None:
        raise stop

    with pytest.raises(stop):
        accept(store, prior(source="new"), judge)
    assert in_use(store) == "old"
    assert store.versions(*OF) == (1, 2)
    assert store.untried(*OF, 2)


def test_what_is_objected_to_is_stored_and_not_used_without_consent(store: PriorStore) -> None:
    acceptance = accept(store, prior(source="new"), lambda stored: "found nothing")
    assert acceptance.objection == "found nothing"
    assert in_use(store) == "old"
    assert store.load(*OF, 2).meta.source == "new"
    assert (
        accept(store, prior(source="newer"), lambda stored: "found nothing", use_anyway=True).objection
        is None
    )
    assert in_use(store) == "newer"


def test_a_trial_in_shadow_needs_no_good_judgement(store: PriorStore) -> None:
    assert accept(store, prior(source="new"), lambda stored: "found nothing", shadow=True).objection is None
    assert in_use(store) == "old"
    assert store.shadow_pointer(*OF) == 2


# What a cross-validation has against it


def held_out(warned_s: float | None, *, cut_off: bool = False) -> HeldOut:
    return HeldOut(Lump(0, 1, (), cut_off), (Judged(0, 0.0, 1.0, 0.0, np.zeros(8)),), warned_s)


def validation(*lumps: HeldOut) -> Validation:
    return Validation(2, lumps, (), ())


def test_one_lump_that_was_found_is_enough() -> None:
    assert objection_to(validation(held_out(1.5), held_out(None))) is None
    assert objection_to(None) is None
    # Whether lumps that the clips do not show to their end would be found in time is not known.
    assert objection_to(validation(held_out(None, cut_off=True))) is None


def test_none_found_or_none_judged_is_an_objection() -> None:
    assert objection_to(validation(held_out(None), held_out(None))) is not None
    assert objection_to(validation(held_out(None), held_out(2.0, cut_off=True))) is not None
    assert objection_to(replace(validation(), failures=("nothing can be learned",))) is not None


# What it learned from


@pytest.mark.parametrize(
    ("text", "names", "missing"),
    [
        ("a.mp4", ["a.mp4"], ()),
        ("a.mp4 + b.mp4", ["b.mp4", "a.mp4"], ()),
        ("a.mp4 + b.mp4 + c.mp4", ["b.mp4"], ("a.mp4", "c.mp4")),
        ("a.mp4, b.mp4", ["a.mp4", "b.mp4"], ()),  # as it was stored before 0.2
        ("a.mp4, b.mp4, c.mp4", ["c.mp4"], ("a.mp4", "b.mp4")),
        ("day/a.mp4, night/a.mp4", ["/kept/a.mp4"], ("a.mp4",)),
        ("a.mp4 + a.mp4", ["a.mp4", "a.mp4"], ()),
        ("x, y + z.mp4 + b.mp4", ["x, y + z.mp4", "b.mp4"], ()),
        ("a.mp4 + aa.mp4", ["a.mp4"], ("aa.mp4",)),
        ("", [], ()),
        ("camera 1", [], ("camera 1",)),
    ],
)
def test_clips_that_a_refinement_lacks(text: str, names: list[str], missing: tuple[str, ...]) -> None:
    assert missing_sources(text, names) == missing


def test_clips_are_named_without_their_folders() -> None:
    text = sources_text(["/videos/day/a.mp4", "b.mp4"])
    assert text == "a.mp4 + b.mp4"
    assert missing_sources(text, ["b.mp4", "a.mp4"]) == ()
