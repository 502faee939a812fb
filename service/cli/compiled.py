"""Kernels that an image brings compiled: put where numba looks, which must be a folder that can be written.

`LUMPWATCH_KERNELS` names the image's folder, `NUMBA_CACHE_DIR` where they are wanted. What a site compiled itself with
another version stays beside them and is passed over by numba.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

FROM, TO = "LUMPWATCH_KERNELS", "NUMBA_CACHE_DIR"
_SAME = ".image"
"""Names the image whose kernels are there."""


def unpack_kernels(environ: Mapping[str, str] = os.environ) -> int:
    """Copy them unless they are there already; how many files. A store that cannot be written costs time, not more."""
    source, target = environ.get(FROM), environ.get(TO)
    if not source or not target:
        return 0
    with contextlib.suppress(OSError):
        return _copy(Path(source), Path(target))
    return 0


def _copy(source: Path, target: Path) -> int:
    files = sorted(path.relative_to(source) for path in source.rglob("*.nb?"))
    same = "\n".join(f"{file} {(source / file).stat().st_mtime_ns}" for file in files)
    mark = target / _SAME
    if mark.is_file() and mark.read_text(encoding="utf-8") == same:
        return 0
    for file in files:
        # Another process may read or write there at this moment: each file appears as a whole.
        (target / file).parent.mkdir(parents=True, exist_ok=True)
        unfinished = (target / file).with_suffix(f".{os.getpid()}")
        shutil.copyfile(source / file, unfinished)
        unfinished.replace(target / file)
    mark.write_text(same, encoding="utf-8")
    return len(files)
