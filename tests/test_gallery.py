"""The gallery runs, and its page is up to date."""

from __future__ import annotations

import importlib
from pathlib import Path

import matplotlib
import pytest

import lumpwatch.models
from docs.gallery.page import HERE, IMAGES, SCRIPTS, page_text

matplotlib.use("Agg")


@pytest.mark.parametrize("name", lumpwatch.models.__all__)
def test_every_name_can_be_imported(name: str) -> None:
    assert getattr(lumpwatch.models, name) is not None
    assert name in dir(lumpwatch.models)


def test_other_names_are_refused() -> None:
    with pytest.raises(AttributeError, match=r"lumpwatch\.models.*no attribute 'Nothing'"):
        _ = lumpwatch.models.Nothing


def test_the_page_is_up_to_date() -> None:
    assert (HERE / "README.md").read_text(encoding="utf-8") == page_text()
    assert all((IMAGES / f"{name}.png").exists() for name in SCRIPTS)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_draws_its_picture(name: str, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    importlib.import_module(f"docs.gallery.{name}").main(picture)
    assert picture.stat().st_size > 5000
