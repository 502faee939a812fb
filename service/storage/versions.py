"""Numbered versions of one thing in a folder, and which of them is in use.

    <folder>/000001<suffix>, 000002<suffix>, …
    <folder>/current          the number in use, as text

Every file appears whole or not at all.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.atomic import replace_file, write_new_file

_DIGITS = 9
"""Of a version: more would be no number that was ever given."""


class StoreError(LumpwatchError):
    """The store cannot be read or written; the text names the path."""


@dataclass(frozen=True, slots=True)
class Versions:
    """The versions in one folder."""

    folder: Path
    suffix: str
    keep: int = 10

    def all(self) -> tuple[int, ...]:
        """All stored versions, oldest first. Raises StoreError."""
        try:
            names = [path.stem for path in self.folder.iterdir() if path.suffix == self.suffix]
        except FileNotFoundError:
            return ()
        except OSError as error:
            raise StoreError(f"{self.folder}: cannot be read ({error.strerror})") from error
        return tuple(
            sorted(
                int(name) for name in names if name.isascii() and name.isdecimal() and len(name) <= _DIGITS
            )
        )

    def path(self, version: int) -> Path:
        """File of a version."""
        return self.folder / f"{version:06d}{self.suffix}"

    @property
    def pointer(self) -> int | None:
        """The version that is set to be used, None where none is set or the pointer is unreadable."""
        return self.number("current")

    def number(self, name: str) -> int | None:
        """The version that a pointer of that name holds; None where there is none, or it is unreadable."""
        try:
            with (self.folder / name).open(encoding="ascii", errors="replace") as file:
                text = file.read(64)
        except OSError:
            return None
        text = text.strip()
        return int(text) if text.isascii() and text.isdigit() and len(text) <= _DIGITS else None

    def candidates(self) -> tuple[tuple[int, ...], str | None]:
        """What may be used, best first, and what is wrong with the pointer."""
        versions, wanted = self.all(), self.pointer
        missing = wanted is not None and wanted not in versions
        problem = f"{self.path(wanted or 0)}: the version in use is missing" if missing else None
        return tuple(v for v in reversed(versions) if wanted is None or v <= wanted), problem

    def save(self, content: bytes) -> int:
        """Store as the newest version and use it; old versions beyond `keep` are removed.

        Raises StoreError; what was stored before stays as it was.
        """
        with self.writing():
            self.folder.mkdir(parents=True, exist_ok=True)
            version = max(self.all(), default=0) + 1
            while not write_new_file(self.path(version), content):
                version += 1  # another process stored one in the meantime
        self.use(version)
        for old in self.all()[: -self.keep]:
            with contextlib.suppress(OSError):
                self.path(old).unlink()
        return version

    def check_writable(self) -> None:
        """Raises StoreError where the disk takes nothing, by a small file that is gone at once."""
        with self.writing():
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder) as file:
                file.write(b"\0" * 4096)

    def use(self, version: int) -> None:
        """Set a version to be used. Raises StoreError."""
        self.point("current", version)

    def point(self, name: str, version: int) -> None:
        """Let a pointer of that name hold a version. Raises StoreError."""
        with self.writing():
            replace_file(self.folder / name, f"{version}\n".encode())

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Raises StoreError naming the folder for what the disk refuses."""
        try:
            yield
        except OSError as error:
            raise StoreError(f"{self.folder}: cannot be written ({error.strerror})") from error
