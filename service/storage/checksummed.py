"""Content with a head line that says what it is, how long, and its checksum."""

from __future__ import annotations

import hashlib


class SealError(ValueError):
    """Content is not what it should be; the text continues the name of a file."""


def seal(kind: str, version: int, body: bytes) -> bytes:
    """The bytes of a file: `lumpwatch-KIND VERSION SHA256 LENGTH` and the body."""
    digest = hashlib.sha256(body).hexdigest()
    return f"lumpwatch-{kind} {version} {digest} {len(body)}\n".encode() + body


def unseal(kind: str, version: int, content: bytes) -> bytes:
    """The body again. Raises SealError."""
    head, newline, _ = content[:256].partition(b"\n")
    words = head.split(b" ")
    if not newline or len(words) != 4 or words[0] != f"lumpwatch-{kind}".encode():
        raise SealError(f"is not a lumpwatch {kind}")
    if words[1] != str(version).encode():
        found = words[1].decode(errors="replace")
        raise SealError(f"has format {found}, this version reads format {version}")
    body = content[len(head) + 1 :]
    if not words[3].isdigit() or int(words[3]) != len(body):
        raise SealError("is truncated or has bytes to spare")
    if hashlib.sha256(body).hexdigest().encode() != words[2]:
        raise SealError("is corrupt (its checksum does not match)")
    return body
