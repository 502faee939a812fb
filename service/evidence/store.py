"""The evidence below one folder: what is there, and what must go.

    <store>/evidence/<camera>/<roi>/<id>/           see `lumpwatch.service.evidence.folder`
    <store>/evidence/<camera>/.writing.<roi>.<id>/  while it is written

A folder gets its name when all its files are on the disk. Evidence is bounded in days and bytes: the
oldest goes first, that with a verdict last. What another process removes meanwhile is no error.
"""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.config import EvidenceConfig
from lumpwatch.service.evidence.folder import Evidence, EvidenceError, read_evidence
from lumpwatch.service.protocol import META, EvidenceMeta

_ID = re.compile(r"(\d{15})-\d{6,}")
_WRITING = ".writing."
_MIB = 1 << 20
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Entry:
    """A folder of evidence, seen from outside."""

    folder: Path
    camera: str
    roi: str
    id: str
    time_s: float
    """When the alarm was raised, wall clock."""
    size: int
    """Bytes on the disk."""


class EvidenceStore:
    """All evidence of a site."""

    def __init__(
        self, store: Path, disk: Callable[[Path], int] = lambda path: shutil.disk_usage(path).total
    ) -> None:
        """`disk` gives the size of the disk under a folder, bytes."""
        self.root = store / "evidence"
        self._disk = disk

    def folder(self, camera: str, roi: str, evidence: str) -> Path:
        """Where a piece of evidence lies, or would. Raises EvidenceError for what is no id."""
        if not _ID.fullmatch(evidence):
            raise EvidenceError(f"'{evidence[:60]}' is not the id of evidence")
        return self.root / camera / roi / evidence

    def entries(self, camera: str = "*", roi: str = "*") -> list[Entry]:
        """All evidence, oldest first. Raises OSError."""
        found = [
            Entry(folder, folder.parts[-3], folder.parts[-2], folder.name, int(match[1]) / 1000, size)
            for folder in self.root.glob(f"{camera}/{roi}/*")
            if (match := _ID.fullmatch(folder.name)) and (size := _size(folder)) is not None
        ]
        return sorted(found, key=lambda entry: (entry.time_s, entry.folder))

    def listed(self, camera: str = "*", roi: str = "*") -> Iterator[Evidence]:
        """The evidence that can be read, oldest first."""
        for entry in self.entries(camera, roi):
            with contextlib.suppress(EvidenceError):
                yield read_evidence(entry.folder)

    def find(self, name: str) -> Evidence:
        """By `CAMERA/ROI/ID`, or by the id alone where only one has it. Raises EvidenceError."""
        camera, roi, evidence = ("*", "*", name) if "/" not in name else (*name.split("/"), "", "")[:3]
        found = [entry for entry in self.entries(camera or "*", roi or "*") if entry.id == evidence]
        if not found:
            raise EvidenceError(f"{self.root}: holds no evidence {name}")
        if len(found) > 1:
            names = ", ".join(f"{entry.camera}/{entry.roi}/{entry.id}" for entry in found)
            raise EvidenceError(f"{name}: is the id of several: {names}")
        return read_evidence(found[0].folder)

    def write(
        self, camera: str, roi: str, evidence: str, fill: Callable[[Path], EvidenceMeta]
    ) -> EvidenceMeta:
        """Let `fill` write the files of a piece of evidence, all or none. Raises what it raises, OSError."""
        target = self.folder(camera, roi, evidence)
        temporary = self.root / camera / f"{_WRITING}{roi}.{evidence}"
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        try:
            meta = fill(temporary)
            target.parent.mkdir(exist_ok=True)
            temporary.rename(target)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        return meta

    def clean(self, camera: str) -> int:
        """Remove what a process that was killed had not finished writing or removing; how many there were."""
        own = self.root / camera
        halves = [
            folder
            for folder in own.glob("*/*")
            if _ID.fullmatch(folder.name) and not (folder / META).exists()
        ]
        stale = [*own.glob(f"{_WRITING}*"), *halves]
        for folder in stale:
            shutil.rmtree(folder, ignore_errors=True)
        return len(stale)

    def limit(self, config: EvidenceConfig) -> int:
        """Bytes that all evidence may take on its disk. Raises OSError."""
        folder = self.root
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        return min(config.max_mb * _MIB, int(config.max_share * self._disk(folder)))

    def prune(self, config: EvidenceConfig, now_s: float, judged: Callable[[Entry], bool]) -> dict[str, int]:
        """Remove what is too old or too much; how many for which reason. Raises OSError."""
        limit = self.limit(config)
        removed = {"age": 0, "space": 0}
        kept: list[tuple[bool, Entry]] = []
        for entry in self.entries():
            marked = judged(entry)
            days = config.keep_days
            if marked and config.keep_judged_days is not None:
                days = config.keep_judged_days
            if now_s - entry.time_s > days * _DAY_S:
                removed["age"] += _remove(entry.folder)
            else:
                kept.append((marked, entry))
        size = sum(entry.size for _, entry in kept)
        for _, entry in sorted(kept, key=lambda item: item[0]):  # stable: the oldest first among each
            if size <= limit:
                break
            removed["space"] += _remove(entry.folder)
            size -= entry.size
        return removed


def _size(folder: Path) -> int | None:
    """Bytes of a folder's files; None where it is no evidence, or no longer."""
    try:
        if not (folder / META).is_file():
            return None
        return sum(file.stat().st_size for file in folder.iterdir())
    except FileNotFoundError:
        return None


def _remove(folder: Path) -> int:
    # Without its meta file it is no evidence any more, even where the rest cannot be removed.
    (folder / META).unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    return 1
