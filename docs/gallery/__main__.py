"""Builds the gallery: `python -m docs.gallery [--all]`. Scripts older than their picture are left out."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from docs.gallery.page import HERE, IMAGES, SCRIPTS, page_text


def main() -> None:
    """Draw the pictures and write the page."""
    parser = argparse.ArgumentParser(prog="python -m docs.gallery", description=__doc__)
    parser.add_argument("--all", action="store_true", help="draw every picture again")
    draw_all = parser.parse_args().all
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name in SCRIPTS:
        script, picture = HERE / f"{name}.py", IMAGES / f"{name}.png"
        if draw_all or not picture.exists() or picture.stat().st_mtime < script.stat().st_mtime:
            importlib.import_module(f"docs.gallery.{name}").main(picture)
    Path(HERE / "README.md").write_text(page_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
