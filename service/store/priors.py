"""The store of priors: numbered versions of each ROI's prior, and which one is in use.

    <store>/priors/<camera>/<roi>/000001.prior, 000002.prior, …
    <store>/priors/<camera>/<roi>/current          the number in use, as text

Every file appears whole or not at all. A version that cannot be read is passed over for the newest
older one, and the problem is reported.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from service.errors import LumpwatchError
from service.store import atomic
from service.store.prior import MAX_BYTES, Prior, PriorError, decode, encode

_SUFFIX = ".prior"


class StoreError(LumpwatchError):
    """The store cannot be read or written; the text names the path."""


@dataclass(frozen=True, slots=True)
class Found:
    """The prior to use, and what went wrong on the way to it."""

    prior: Prior | None
    problems: tuple[str, ...] = ()


def read_file(path: Path) -> Prior:
    """A prior from any file; raises PriorError."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PriorError(f"{path}: is larger than {MAX_BYTES >> 20} MiB")
        content = path.read_bytes()
    except OSError as error:
        raise PriorError(f"{path}: cannot be read ({error.strerror})") from error
    return decode(content, str(path))


@dataclass(frozen=True, slots=True)
class PriorStore:
    """The priors below one folder."""

    root: Path
    keep: int = 10

    def folder(self, camera: str, roi: str) -> Path:
        """Where the versions of a ROI lie."""
        return self.root / "priors" / camera / roi

    def versions(self, camera: str, roi: str) -> tuple[int, ...]:
        """All stored versions, oldest first."""
        folder = self.folder(camera, roi)
        try:
            names = [path.stem for path in folder.iterdir() if path.suffix == _SUFFIX]
        except FileNotFoundError:
            return ()
        except OSError as error:
            raise StoreError(f"{folder}: cannot be read ({error.strerror})") from error
        return tuple(sorted(int(name) for name in names if name.isascii() and name.isdecimal()))

    def path(self, camera: str, roi: str, version: int) -> Path:
        """File of a version."""
        return self.folder(camera, roi) / f"{version:06d}{_SUFFIX}"

    def load(self, camera: str, roi: str, version: int) -> Prior:
        """One version; raises PriorError, also for a prior of another camera or ROI."""
        prior = read_file(self.path(camera, roi, version))
        check_owner(prior, camera, roi, str(self.path(camera, roi, version)))
        return prior.with_version(version)

    def pointer(self, camera: str, roi: str) -> int | None:
        """The version that is set to be used, None where none is set or the pointer is unreadable."""
        try:
            text = (self.folder(camera, roi) / "current").read_text(encoding="ascii", errors="replace")
        except OSError:
            return None
        return int(text) if text.strip().isdigit() else None

    def current(self, camera: str, roi: str) -> Found:
        """The prior in use; a version that cannot be read falls back to the newest older one."""
        versions = self.versions(camera, roi)
        wanted = self.pointer(camera, roi)
        candidates = [v for v in reversed(versions) if wanted is None or v <= wanted]
        problems: list[str] = []
        if wanted is not None and wanted not in versions:
            problems.append(f"{self.path(camera, roi, wanted)}: the version in use is missing")
        for version in candidates:
            try:
                return Found(self.load(camera, roi, version), tuple(problems))
            except PriorError as error:
                problems.append(str(error))
        return Found(None, tuple(problems))

    def save(self, prior: Prior) -> Prior:
        """Store a prior as the newest version and use it; old versions beyond `keep` are removed.

        Raises StoreError; what was stored before stays as it was.
        """
        camera, roi = prior.meta.camera, prior.meta.roi
        folder = self.folder(camera, roi)
        content = encode(prior)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            version = max(self.versions(camera, roi), default=0) + 1
            while not atomic.write_new(self.path(camera, roi, version), content):
                version += 1  # another process stored one in the meantime
            atomic.replace(folder / "current", f"{version}\n".encode())
        except OSError as error:
            raise StoreError(f"{folder}: cannot be written ({error.strerror})") from error
        self._remove_old(camera, roi)
        return prior.with_version(version)

    def use(self, camera: str, roi: str, version: int) -> Prior:
        """Set a stored version to be used (roll back); raises PriorError, StoreError."""
        if version not in self.versions(camera, roi):
            raise StoreError(f"camera {camera}, roi {roi}: there is no version {version} of its prior")
        prior = self.load(camera, roi, version)
        try:
            atomic.replace(self.folder(camera, roi) / "current", f"{version}\n".encode())
        except OSError as error:
            raise StoreError(f"{self.folder(camera, roi)}: cannot be written ({error.strerror})") from error
        return prior

    def _remove_old(self, camera: str, roi: str) -> None:
        in_use = self.pointer(camera, roi)
        for version in self.versions(camera, roi)[: -self.keep]:
            if version != in_use:
                with contextlib.suppress(OSError):
                    self.path(camera, roi, version).unlink()


def check_owner(prior: Prior, camera: str, roi: str, name: str) -> None:
    """Raises PriorError for a prior that belongs to another camera or ROI."""
    if (prior.meta.camera, prior.meta.roi) != (camera, roi):
        raise PriorError(
            f"{name}: belongs to camera {prior.meta.camera}, roi {prior.meta.roi}, "
            f"not to camera {camera}, roi {roi}"
        )
