"""A piece of evidence as it lies in its folder; `lumpwatch.service.protocol.evidence` defines what it consists of."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import META, EvidenceMeta, StoredFile


class EvidenceError(LumpwatchError):
    """Evidence cannot be read or is damaged; the text names the file."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """A folder with its meta data."""

    folder: Path
    meta: EvidenceMeta

    def check(self) -> None:
        """Read all files and compare checksums. Raises EvidenceError naming the one that is damaged."""
        for name, stored in self.meta.files.items():
            self.read(name, stored)

    def read(self, name: str, stored: StoredFile | None = None) -> bytes:
        """A file of it, checked. Raises EvidenceError."""
        stored = stored or self.meta.files.get(name)
        if stored is None:
            raise EvidenceError(f"{self.folder}: has no {name}")
        path = self.folder / name
        try:
            content = read_bounded(path, stored.size)
        except OSError as error:
            raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from error
        if len(content) != stored.size:
            raise EvidenceError(f"{path}: is damaged ({len(content)} bytes, expected {stored.size})")
        if hashlib.sha256(content).hexdigest() != stored.sha256:
            raise EvidenceError(f"{path}: is damaged (its checksum does not match)")
        return content


def read_evidence(folder: Path) -> Evidence:
    """The evidence in a folder; its other files are not looked at. Raises EvidenceError."""
    path = folder / META
    try:
        found = Evidence(folder, EvidenceMeta.model_validate_json(read_bounded(path)))
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror}); is this evidence?") from error
    except ValidationError as error:
        raise EvidenceError(f"{path}: is not what evidence says of itself") from error
    if odd := [name for name in found.meta.files if Path(name).name != name]:
        raise EvidenceError(f"{path}: '{odd[0]}' is not the name of a file")
    return found
