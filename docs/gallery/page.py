"""The gallery's page, from the scripts' docstrings."""

from __future__ import annotations

import ast
from pathlib import Path

HERE = Path(__file__).parent
IMAGES = HERE.parent / "images" / "gallery"
SCRIPTS = (
    "motion_models",
    "bouncing_square",
    "where_it_bounces",
    "own_motion_model",
    "own_likelihood",
    "model_choice",
    "resampling",
    "background_and_shadow",
    "close_targets",
    "scores",
)


def page_text() -> str:
    """Markdown: of each script its docstring, its picture and where it is."""
    parts = [
        "<!-- Written by `make docs` from the scripts; edit these instead. -->",
        "# Gallery",
        "Each script takes the numerics by one import, `from lumpwatch.models import …`, needs no daemon, "
        "runs in seconds and draws the picture below it: "
        "`python -m docs.gallery.NAME` writes `NAME.png` into the current folder.",
    ]
    for name in SCRIPTS:
        told = ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text(encoding="utf-8"))) or ""
        title, _, text = told.partition("\n\n")
        parts += [
            f"## {title.rstrip('.')}",
            text,
            f"![{title}](../images/gallery/{name}.png)",
            f"[{name}.py]({name}.py)",
        ]
    return "\n\n".join(part for part in parts if part) + "\n"
