"""Bytes and texts that are nearly right."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Random = np.random.Generator

_ODD = (
    b"", b"\x00", b"\xff" * 8, b"\x1b]0;x\x07", b"-1", b"1e308", b"NaN", b"9" * 40, b"[/]", b"\n", b"\xed\xa0\x80",
    b"${X}", b"{", b'"', b"&a *a", b"null", b"\xc2\xb2", b"../../x", b"%00", b"18446744073709551616",
)  # fmt: skip


def _at(content: bytes, rng: Random) -> int:
    return int(rng.integers(0, len(content) + 1))


def _flip(content: bytes, rng: Random) -> bytes:
    made = bytearray(content)
    for at in rng.integers(0, max(1, len(made)), int(rng.integers(1, 9))):
        made[at : at + 1] = bytes([int(rng.integers(0, 256))])
    return bytes(made)


def _cut(content: bytes, rng: Random) -> bytes:
    return content[: _at(content, rng)]


def _leave_out(content: bytes, rng: Random) -> bytes:
    first, last = sorted((_at(content, rng), _at(content, rng)))
    return content[:first] + content[last:]


def _put_in(content: bytes, rng: Random) -> bytes:
    at = _at(content, rng)
    return content[:at] + _ODD[int(rng.integers(0, len(_ODD)))] + content[at:]


def _repeat(content: bytes, rng: Random) -> bytes:
    first, last = sorted((_at(content, rng), _at(content, rng)))
    piece = content[first : min(last, first + 256)]
    return content[:first] + piece * int(rng.integers(2, 20)) + content[last:]


def _noise(_: bytes, rng: Random) -> bytes:
    return rng.bytes(int(rng.integers(0, 400)))


_WAYS: tuple[Callable[[bytes, Random], bytes], ...] = (
    _flip,
    _cut,
    _leave_out,
    _put_in,
    _put_in,
    _repeat,
    _noise,
)


def mutated(content: bytes, rng: Random) -> bytes:
    """The content after one to three mutations."""
    for _ in range(int(rng.integers(1, 4))):
        content = _WAYS[int(rng.integers(0, len(_WAYS)))](content, rng)
    return content
