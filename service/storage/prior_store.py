"""The store of priors: numbered versions of each ROI's prior, and which one is in use.

    <store>/priors/<camera>/<roi>/000001.prior, 000002.prior, …
    <store>/priors/<camera>/<roi>/000001.html      the report of its training, where it was trained here
    <store>/priors/<camera>/<roi>/000001.lumps     labelled lumps cut for proof tests, where it was trained here
    <store>/priors/<camera>/<roi>/current          the number in use, as text; 0: the stated defaults
    <store>/priors/<camera>/<roi>/shadow           the number that is tried in shadow, while one is
    <store>/priors/<camera>/<roi>/000002.trial     this version has never been in use

Every file appears whole or not at all. A version in use that cannot be read is passed over for the
newest older one that has been in use, and the problem is reported. What was only ever tried in shadow
is never taken by itself.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.core import LumpCut, read_bounded
from lumpwatch.service.storage.atomic import replace_file, write_new_file
from lumpwatch.service.storage.lump_cuts import MOST_BYTES, LumpCutError, decode_cuts, encode_cuts
from lumpwatch.service.storage.prior_file import MAX_BYTES, Prior, PriorError, decode_prior, encode_prior
from lumpwatch.service.storage.versions import StoreError, Versions

_SUFFIX = ".prior"
_TRIAL = ".trial"
_REPORT = ".html"
_LUMPS = ".lumps"


@dataclass(frozen=True, slots=True)
class Found:
    """The prior to use, and what went wrong on the way to it."""

    prior: Prior | None
    problems: tuple[str, ...] = ()


def read_file(path: Path) -> Prior:
    """A prior from any file; raises PriorError."""
    try:
        content = read_bounded(path, MAX_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise PriorError(f"{path}: is larger than {MAX_BYTES >> 20} MiB") from error
        raise PriorError(f"{path}: cannot be read ({error.strerror})") from error
    return decode_prior(content, str(path))


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
        return self._of(camera, roi).all()

    def check_writable(self, camera: str, roi: str) -> None:
        """Raises StoreError where nothing can be stored: to be asked before minutes of work, not after them."""
        self._of(camera, roi).check_writable()

    def path(self, camera: str, roi: str, version: int) -> Path:
        """File of a version."""
        return self._of(camera, roi).path(version)

    def report_path(self, camera: str, roi: str, version: int) -> Path:
        """The report of the training that made a version; it goes when the version goes."""
        return self.path(camera, roi, version).with_suffix(_REPORT)

    def keep_lumps(self, camera: str, roi: str, version: int, cuts: Sequence[LumpCut]) -> None:
        """Keep lumps cut for proof tests beside a version; they go when the version goes. Raises StoreError."""
        with self._of(camera, roi).writing():
            replace_file(self._lumps(camera, roi, version), encode_cuts(cuts))

    def lumps(self, camera: str, roi: str, version: int) -> tuple[LumpCut, ...]:
        """The lumps beside a version; none where none were cut. Raises LumpCutError."""
        path = self._lumps(camera, roi, version)
        try:
            content = read_bounded(path, MOST_BYTES)
        except FileNotFoundError:
            return ()
        except OSError as error:
            raise LumpCutError(f"{path}: cannot be read ({error.strerror})") from error
        return decode_cuts(content, str(path))

    def load(self, camera: str, roi: str, version: int) -> Prior:
        """One version; raises PriorError, also for a prior of another camera or ROI."""
        prior = read_file(self.path(camera, roi, version))
        check_owner(prior, camera, roi, str(self.path(camera, roi, version)))
        return prior.with_version(version)

    def pointer(self, camera: str, roi: str) -> int | None:
        """The version that is set to be used, None where none is set or the pointer is unreadable.

        0: the stated defaults.
        """
        return self._of(camera, roi).pointer

    def shadow_pointer(self, camera: str, roi: str) -> int | None:
        """The version that is to run in shadow; None where none is, or where it is in use already."""
        wanted = self._of(camera, roi).number("shadow")
        return None if wanted == self.pointer(camera, roi) else wanted

    def untried(self, camera: str, roi: str, version: int) -> bool:
        """Whether a version has never been in use."""
        return self._mark(camera, roi, version).exists()

    def current(self, camera: str, roi: str) -> Found:
        """The prior in use; a version that cannot be read falls back to the newest older one."""
        versions = self.versions(camera, roi)
        wanted = self.pointer(camera, roi)
        if wanted == 0:
            return Found(None)
        older = [v for v in reversed(versions) if wanted is None or v < wanted]
        candidates = [wanted] if wanted in versions else []
        candidates += [v for v in older if not self.untried(camera, roi, v)]
        problems: list[str] = []
        if wanted is not None and wanted not in versions:
            problems.append(f"{self.path(camera, roi, wanted)}: the version in use is missing")
        for version in candidates:
            try:
                return Found(self.load(camera, roi, version), tuple(problems))
            except PriorError as error:
                problems.append(str(error))
        return Found(None, tuple(problems))

    def before(self, camera: str, roi: str, version: int) -> Prior | None:
        """The newest prior before a version that has been in use and can be read."""
        for older in reversed(self.versions(camera, roi)):
            if older < version and not self.untried(camera, roi, older):
                with contextlib.suppress(PriorError):
                    return self.load(camera, roi, older)
        return None

    def shadow(self, camera: str, roi: str) -> Found:
        """The prior to run in shadow; nothing stands in for one that cannot be read."""
        version = self.shadow_pointer(camera, roi)
        if version is None:
            return Found(None)
        try:
            return Found(self.load(camera, roi, version))
        except PriorError as error:
            return Found(None, (str(error),))

    def stage(self, prior: Prior) -> Prior:
        """Store a prior as the newest version, neither in use nor in shadow yet; see `keep`.

        Raises StoreError; what was stored before stays as it was.
        """
        camera, roi = prior.meta.camera, prior.meta.roi
        version = self._store(prior, trial=True)
        self._remove_old(camera, roi, version)
        return prior.with_version(version)

    def save(self, prior: Prior, *, shadow: bool = False) -> Prior:
        """Store a prior as the newest version, to be used or to run in shadow; see `keep`.

        Raises StoreError; what was stored before stays as it was.
        """
        camera, roi = prior.meta.camera, prior.meta.roi
        version = self._store(prior, trial=shadow)
        if shadow:
            self._of(camera, roi).point("shadow", version)
        else:
            self._take(camera, roi, version)
        self._remove_old(camera, roi)
        return prior.with_version(version)

    def use(self, camera: str, roi: str, version: int) -> Prior:
        """Set a stored version to be used (roll back); raises PriorError, StoreError."""
        prior = self._stored(camera, roi, version)
        self._take(camera, roi, version)
        return prior

    def use_defaults(self, camera: str, roi: str) -> None:
        """Use no prior but the stated defaults, until one is stored, promoted or gone back to."""
        with self._of(camera, roi).writing():
            self.folder(camera, roi).mkdir(parents=True, exist_ok=True)
        self._take(camera, roi, 0)

    def set_shadow(self, camera: str, roi: str, version: int) -> Prior:
        """Run a stored version in shadow; raises PriorError, StoreError."""
        prior = self._stored(camera, roi, version)
        if version == self.pointer(camera, roi):
            raise StoreError(f"camera {camera}, roi {roi}: version {version} is in use, not in shadow")
        self._of(camera, roi).point("shadow", version)
        return prior

    def promote(self, camera: str, roi: str, version: int | None = None) -> Prior:
        """Use what runs in shadow, which must be `version` where one is given. Raises PriorError, StoreError."""
        return self.use(camera, roi, self._in_shadow(camera, roi, version))

    def drop_shadow(self, camera: str, roi: str, version: int | None = None) -> int:
        """Run nothing in shadow any more; the version, which stays in the store. Raises StoreError."""
        dropped = self._in_shadow(camera, roi, version)
        with self._of(camera, roi).writing():
            (self.folder(camera, roi) / "shadow").unlink(missing_ok=True)
        return dropped

    def _of(self, camera: str, roi: str) -> Versions:
        return Versions(self.folder(camera, roi), _SUFFIX, self.keep)

    def _stored(self, camera: str, roi: str, version: int) -> Prior:
        if version not in self.versions(camera, roi):
            raise StoreError(f"camera {camera}, roi {roi}: there is no version {version} of its prior")
        return self.load(camera, roi, version)

    def _in_shadow(self, camera: str, roi: str, version: int | None) -> int:
        found = self.shadow_pointer(camera, roi)
        if found is None:
            raise StoreError(f"camera {camera}, roi {roi}: no prior runs in shadow")
        if version not in (None, found):
            raise StoreError(f"camera {camera}, roi {roi}: version {found} runs in shadow, not {version}")
        return found

    def _store(self, prior: Prior, *, trial: bool) -> int:
        camera, roi = prior.meta.camera, prior.meta.roi
        content = encode_prior(prior)
        with self._of(camera, roi).writing():
            self.folder(camera, roi).mkdir(parents=True, exist_ok=True)
            version = max(self.versions(camera, roi), default=0) + 1
            while not self._write_new(camera, roi, version, content, trial):
                version += 1  # another process stored one in the meantime
        return version

    def _write_new(self, camera: str, roi: str, version: int, content: bytes, trial: bool) -> bool:
        """Write a version, marked before it is there; False where the number is taken."""
        path, mark = self.path(camera, roi, version), self._mark(camera, roi, version)
        if not trial:
            return write_new_file(path, content)
        if path.exists() or not write_new_file(mark, b""):
            return False
        if write_new_file(path, content):
            return True
        mark.unlink(missing_ok=True)
        return False

    def _take(self, camera: str, roi: str, version: int) -> None:
        """Use a version. A process that dies on the way leaves either the old one in use or the new one."""
        before = self.pointer(camera, roi)
        if before is not None:
            self._adopt(camera, roi, before)  # what a process that died may have left undone
        self._of(camera, roi).use(version)
        self._adopt(camera, roi, version)

    def _adopt(self, camera: str, roi: str, version: int) -> None:
        """A version that is in use is neither on trial nor in shadow."""
        versions = self._of(camera, roi)
        with versions.writing():
            self._mark(camera, roi, version).unlink(missing_ok=True)
            if versions.number("shadow") == version:
                (self.folder(camera, roi) / "shadow").unlink(missing_ok=True)

    def _mark(self, camera: str, roi: str, version: int) -> Path:
        return self.path(camera, roi, version).with_suffix(_TRIAL)

    def _lumps(self, camera: str, roi: str, version: int) -> Path:
        return self.path(camera, roi, version).with_suffix(_LUMPS)

    def _remove_old(self, camera: str, roi: str, staged: int | None = None) -> None:
        """Down to `keep`: first what has never been in use, then the oldest.

        What is in use, in shadow or has just been staged stays.
        """
        versions = self.versions(camera, roi)
        needed = (self.pointer(camera, roi), self.shadow_pointer(camera, roi), staged)
        spare = [version for version in versions if version not in needed]
        spare.sort(key=lambda version: not self.untried(camera, roi, version))
        for version in spare[: max(0, len(versions) - self.keep)]:
            with contextlib.suppress(OSError):
                self.path(camera, roi, version).unlink()
                self._mark(camera, roi, version).unlink(missing_ok=True)
                self.report_path(camera, roi, version).unlink(missing_ok=True)
                self._lumps(camera, roi, version).unlink(missing_ok=True)


def check_owner(prior: Prior, camera: str, roi: str, name: str) -> None:
    """Raises PriorError for a prior that belongs to another camera or ROI."""
    if (prior.meta.camera, prior.meta.roi) != (camera, roi):
        raise PriorError(
            f"{name}: belongs to camera {prior.meta.camera}, roi {prior.meta.roi}, "
            f"not to camera {camera}, roi {roi}"
        )
