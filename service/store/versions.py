"""Numbered versions of one thing in a folder, and which of them is in use.

    <folder>/000001<suffix>, 000002<suffix>, …
    <folder>/current          the number in use, as text

Every file appears whole or not at all.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from service.store import atomic
from service.store.priors import StoreError


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
        return tuple(sorted(int(name) for name in names if name.isascii() and name.isdecimal()))

    def path(self, version: int) -> Path:
        """File of a version."""
        return self.folder / f"{version:06d}{self.suffix}"

    @property
    def pointer(self) -> int | None:
        """The version that is set to be used, None where none is set or the pointer is unreadable."""
        try:
            text = (self.folder / "current").read_text(encoding="ascii", errors="replace")
        except OSError:
            return None
        return int(text) if text.strip().isdigit() else None

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
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            version = max(self.all(), default=0) + 1
            while not atomic.write_new(self.path(version), content):
                version += 1  # another process stored one in the meantime
        except OSError as error:
            raise StoreError(f"{self.folder}: cannot be written ({error.strerror})") from error
        self.use(version)
        for old in self.all()[: -self.keep]:
            with contextlib.suppress(OSError):
                self.path(old).unlink()
        return version

    def use(self, version: int) -> None:
        """Set a version to be used. Raises StoreError."""
        try:
            atomic.replace(self.folder / "current", f"{version}\n".encode())
        except OSError as error:
            raise StoreError(f"{self.folder}: cannot be written ({error.strerror})") from error
