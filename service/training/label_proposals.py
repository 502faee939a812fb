"""Proposed labels: a file of MOTChallenge rows that a person turns into labels, or not.

A proposed box has class -1 (nobody has said what it is) and its existence as conf, below 1. Around each
track, where the filter was not sure yet or no longer, rows with conf 0 say that something is there that
nobody vouches for. Accepting a proposal sets conf and class of its boxes to 1; the lines of a rejected one
become comments, so that the place counts as background.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import LabelError, is_proposal, replace_file

HEAD = "# frame,id,x,y,w,h,conf,class,visibility: conf below 1 with class -1 is a proposal, conf 0 is to be ignored\n"


@dataclass(frozen=True, slots=True)
class ProposedBox:
    """The filter's box in one frame; pixels of the whole picture."""

    frame: int
    """From 1."""
    x: float
    y: float
    w: float
    h: float
    existence: float


@dataclass(frozen=True, slots=True)
class Proposal:
    """One proposed lump."""

    id: int
    boxes: tuple[ProposedBox, ...]
    """Of consecutive frames."""
    margin: tuple[ProposedBox, ...] = ()
    """Where it may be as well; to be ignored."""

    @property
    def existence(self) -> float:
        """The highest of any frame."""
        return max(box.existence for box in self.boxes)


def to_text(proposals: Sequence[Proposal]) -> str:
    """The file's content."""
    rows = [HEAD]
    for proposal in proposals:
        kept = {box.frame for box in proposal.boxes}
        both = [*proposal.boxes, *(box for box in proposal.margin if box.frame not in kept)]
        for box in sorted(both, key=lambda box: box.frame):
            conf = min(max(round(box.existence, 3), 0.001), 0.999) if box.frame in kept else 0
            place = ",".join(f"{value:.2f}" for value in (box.x, box.y, box.w, box.h))
            rows.append(f"{box.frame},{proposal.id},{place},{conf:g},-1,-1\n")
    return "".join(rows)


def parse_ids(option: str) -> frozenset[int] | None:
    """What `--accept` says: ids, or None for all. Raises ConfigError."""
    if option.strip() == "all":
        return None
    try:
        return frozenset(int(part) for part in option.split(","))
    except ValueError:
        raise ConfigError(f"--accept {option}: expected all, or ids as in 1,3,4") from None


def accept_proposals(path: Path, ids: Collection[int] | None) -> int:
    """Turn proposals of a file into labels, all for None; the others become comments. Returns how many.

    Raises LabelError where the file cannot be read or written, or does not hold the proposals.
    """
    try:
        lines = read_bounded(path).decode("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise LabelError(f"{path}: cannot be read ({error})") from error
    proposed = {found for line in lines if is_proposal(line) and (found := _id(line)) is not None}
    if not proposed:
        raise LabelError(f"{path}: holds no proposal to accept")
    wanted = proposed if ids is None else set(ids)
    if unknown := wanted - proposed:
        known = ", ".join(map(str, sorted(proposed)))
        raise LabelError(f"{path}: has no proposal {min(unknown)} (has {known})")
    out = []
    for line in lines:
        if line.lstrip().startswith("#") or not line.strip() or _id(line) not in proposed:
            out.append(line)
        elif _id(line) not in wanted:
            out.append(f"# rejected: {line}")
        else:
            out.append(_label(line) if is_proposal(line) else line)
    try:
        replace_file(path, ("\n".join(out) + "\n").encode())
    except OSError as error:
        raise LabelError(f"{path}: cannot be written ({error.strerror})") from error
    return len(wanted)


def _id(line: str) -> int | None:
    try:
        return int(float(line.split(",")[1]))
    except (IndexError, ValueError, OverflowError):
        return None


def _label(line: str) -> str:
    fields = [field.strip() for field in line.split(",")]
    fields[6:8] = ["1", "1"]
    return ",".join(fields)
