"""Evidence over the bus: a monitor lists it and hands out files in pieces, a client puts them together.

| parameters | answer |
|---|---|
| none, or `newest` | JSON: the newest 100, or so many, as `EvidenceMeta` with `verdict` |
| `id` | JSON: that one |
| `id`, `file`, `offset`, `length` | at most `length` bytes of a file from `offset` on |
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from lumpwatch.service.bus import Bus
from lumpwatch.service.evidence.folder import Evidence, EvidenceError, read_evidence
from lumpwatch.service.evidence.store import EvidenceStore
from lumpwatch.service.protocol import (
    CAMERA,
    CLIP,
    META,
    PRIOR,
    STATE,
    STATES,
    STILL,
    TIMES,
    EvidenceMeta,
    EvidenceRequest,
)

PIECE = 1 << 20
"""Bytes of a file in one answer, unless fewer are asked for."""
_MOST_LISTED = 1000
_MOST_BYTES = 8 << 30
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,127}")

Verdicts = Callable[[], dict[tuple[str, str], str]]
"""Tells the verdict that counts, by ROI and evidence id."""


def serve_evidence(
    store: EvidenceStore, camera: str, roi: str, verdicts: Verdicts, piece: int = PIECE
) -> Callable[[EvidenceRequest], bytes]:
    """Answers the evidence requests of a ROI, at most `piece` bytes of a file at once; errors are EvidenceError."""

    def handle(asked: EvidenceRequest) -> bytes:
        if asked.id is None:
            newest = min(asked.newest, _MOST_LISTED)
            entries = store.entries(camera, roi)[-newest:] if newest else []
            known = verdicts()
            return json.dumps(
                [stored for entry in entries if (stored := _listing(entry.folder, known))]
            ).encode()
        evidence = read_evidence(store.folder(camera, roi, asked.id))
        if asked.file is None:
            return json.dumps(as_json(evidence.meta, verdicts())).encode()
        length = piece if asked.length is None else min(asked.length, piece)
        return _piece(evidence, asked.file, asked.offset, length)

    return handle


def as_json(meta: EvidenceMeta, verdicts: dict[tuple[str, str], str]) -> dict[str, Any]:
    """Meta data with the verdict."""
    return {**json.loads(meta.line()), "verdict": verdicts.get((meta.roi, meta.id))}


def fetch_evidence(bus: Bus, key: str, evidence: str, out: Path) -> Evidence:
    """Copy a piece of evidence into `out`/ROI-ID over the bus, checked. Raises EvidenceError."""
    answer = _ask(bus, key, {"id": evidence})
    try:
        meta = EvidenceMeta.model_validate_json(answer)
    except ValidationError as error:
        raise EvidenceError(f"{key}: the answer is no evidence") from error
    _check_asked(meta, key, evidence)

    def fill(folder: Path) -> None:
        (folder / META).write_bytes(meta.line() + b"\n")
        for name, stored in meta.files.items():
            with (folder / name).open("wb") as file:
                while file.tell() < stored.size:
                    piece = _ask(bus, key, {"id": evidence, "file": name, "offset": str(file.tell())})
                    if not piece or len(piece) > stored.size - file.tell():
                        raise EvidenceError(f"{key}: {name} does not end as it should ({stored.size} bytes)")
                    file.write(piece)

    return put_down(meta, out, fill)


def _check_asked(meta: EvidenceMeta, key: str, evidence: str) -> None:
    """Raises EvidenceError for an answer that is not what was asked, or asks for more than evidence takes.

    Names from the bus become names of files here.
    """
    camera, roi = key.split("/")[-3:-1]
    if (meta.camera, meta.roi) != (camera, roi) or evidence not in (meta.id, f"{camera}/{roi}/{meta.id}"):
        raise EvidenceError(f"{key}: the answer is of other evidence")
    if not _FILE_NAME.fullmatch(meta.id):
        raise EvidenceError(f"{key}: the answer's id is no name")
    if unknown := sorted(set(meta.files) - {CLIP, TIMES, STATES, STATE, PRIOR, CAMERA, STILL}):
        raise EvidenceError(f"{key}: {unknown[0]!r:.80} is no file of evidence")
    size = sum(stored.size for stored in meta.files.values())
    if min((stored.size for stored in meta.files.values()), default=0) < 0 or size > _MOST_BYTES:
        raise EvidenceError(f"{key}: no evidence takes {size >> 20} MiB")


def copy_evidence(evidence: Evidence, out: Path) -> Evidence:
    """Copy a piece of evidence from the store into `out`/ROI-ID, checked. Raises EvidenceError."""

    def fill(folder: Path) -> None:
        for name in (META, *evidence.meta.files):
            shutil.copyfile(evidence.folder / name, folder / name)

    return put_down(evidence.meta, out, fill)


def put_down(meta: EvidenceMeta, out: Path, fill: Callable[[Path], None]) -> Evidence:
    """Make the folder of a copy, whole or not at all. Raises EvidenceError."""
    target = out / f"{meta.camera}.{meta.roi}.{meta.id}"
    temporary = out / f".{target.name}.part"
    try:
        if target.exists():
            raise EvidenceError(f"{target}: is there already")
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        try:
            fill(temporary)
            read_evidence(temporary).check()
            temporary.rename(target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise EvidenceError(f"{error.filename or out}: cannot be copied ({error.strerror})") from error
    return read_evidence(target)


def _ask(bus: Bus, key: str, parameters: dict[str, str]) -> bytes:
    replies = bus.ask(key, parameters, timeout_s=10.0)
    if not replies:
        raise EvidenceError(f"{key}: nobody answers; is the daemon running and the name right?")
    if replies[0].payload is None:
        raise EvidenceError(f"{key}: {replies[0].error}")
    return replies[0].payload


def _listing(folder: Path, verdicts: dict[tuple[str, str], str]) -> dict[str, Any] | None:
    try:
        return as_json(read_evidence(folder).meta, verdicts)
    except EvidenceError:
        return None


def _piece(evidence: Evidence, name: str, offset: int, length: int) -> bytes:
    if name not in (META, *evidence.meta.files):
        raise EvidenceError(f"file: '{name[:60]}' is none of {', '.join((META, *evidence.meta.files))}")
    path = evidence.folder / name
    try:
        with path.open("rb") as file:
            file.seek(offset)
            return file.read(length)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from error
