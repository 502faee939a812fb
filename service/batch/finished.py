"""Results of finished tasks on disk, so that a run that was interrupted goes on where it stopped.

One file a task, named by a digest of all that its result depends on: another configuration, prior, video or version of
lumpwatch is another file. Several runs may share a folder. A damaged file is as good as none.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from lumpwatch.service.batch.code import code_digest
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import SealError, replace_file, seal, unseal

log = logging.getLogger(__name__)

R = TypeVar("R")
_FORMAT = 1


def key_of(*parts: str | bytes) -> str:
    """The key of a result that depends on these and on the code of lumpwatch."""
    total = hashlib.sha256()
    for part in (code_digest(), *parts):
        content = part.encode() if isinstance(part, str) else part
        total.update(len(content).to_bytes(8, "big") + content)
    return total.hexdigest()[:32]


def file_identity(path: Path) -> str:
    """What tells a video or a folder of images from another without reading it: names, sizes and times of change.

    Archives are too large to be read twice. Raises OSError.
    """
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    lines = []
    for one in files:
        stat = one.stat()
        lines.append(f"{one.name} {stat.st_size} {stat.st_mtime_ns}")
    return "\n".join(lines)


class Finished(Generic[R]):
    """The results in a folder. Raises LumpwatchError where it cannot be made."""

    def __init__(self, folder: Path, encode: Callable[[R], bytes], decode: Callable[[bytes], R]) -> None:
        self._folder, self._encode, self._decode = folder, encode, decode
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LumpwatchError(f"{folder}: cannot be written ({error.strerror})") from error

    def load(self, key: str) -> R | None:
        """The result of that key, None where there is none that can be read."""
        path = self._path(key)
        try:
            return self._decode(unseal("result", _FORMAT, path.read_bytes()))
        except FileNotFoundError:
            return None
        except (OSError, SealError, ValueError, KeyError) as error:
            log.warning("%s: cannot be used (%s), its task is done again", path, error)
            return None

    def keep(self, key: str, result: R) -> None:
        """Write the result, wholly or not at all. Raises LumpwatchError."""
        try:
            replace_file(self._path(key), seal("result", _FORMAT, self._encode(result)))
        except OSError as error:
            raise LumpwatchError(f"{self._path(key)}: cannot be written ({error.strerror})") from error

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.result"
