"""Where the real footage lies that the repository does not hold."""

from __future__ import annotations

import os
from pathlib import Path


def footage_folder(name: str, *files: str) -> Path | None:
    """The footage of that name, or None where it or one of its `files` is missing.

    It is looked for in $LUMPWATCH_FOOTAGE, then in ../shared/data beside the repository.
    """
    root = os.environ.get("LUMPWATCH_FOOTAGE")
    base = Path(root) if root else Path(__file__).parents[2] / "shared" / "data"
    folder = base / name
    return folder if folder.is_dir() and all((folder / file).is_file() for file in files) else None
