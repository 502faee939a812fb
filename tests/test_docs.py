"""The generated pages are those of today's code, and the README's links lead somewhere."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest

from docs.generate import pages

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.name)
def test_reference_is_up_to_date(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == pages()[path], "run make docs"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{path.name} links to {target}"


def test_every_name_of_the_equations_exists() -> None:
    names = re.findall(r"`([a-z_.]+\.[A-Za-z_]+)` \|", (ROOT / "docs" / "equations.md").read_text("utf-8"))
    assert len(names) > 15
    for name in names:
        module, _, item = name.rpartition(".")
        assert hasattr(import_module(f"lumpwatch.models.{module}"), item), name
