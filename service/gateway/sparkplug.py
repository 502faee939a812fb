"""Payloads of Sparkplug B, written and read by hand over the published schema (Eclipse Tahu, sparkplug_b.proto).

Of the schema's types there are unsigned integers, doubles, booleans and null; a reader skips what it does not know.
Protocol buffers: a field is a key (number << 3 | wire type) and a value; wire type 0 is a varint, 1 eight bytes, 2 a
length and so many bytes, 5 four bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

UINT64, DOUBLE, BOOLEAN = 8, 10, 11
"""Sparkplug's data types."""
# Fields of Payload, and of Metric.
_TIMESTAMP, _METRICS, _SEQ = 1, 2, 3
_NAME, _ALIAS, _TIME, _DATATYPE, _IS_NULL, _LONG, _DOUBLE, _BOOLEAN = 1, 2, 3, 4, 7, 11, 13, 14
_MOST_METRICS = 1000


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric. In a birth it has name, alias and type, later the alias alone."""

    value: float | bool | None
    datatype: int
    name: str | None = None
    alias: int | None = None


def encode(metrics: Iterable[Metric], timestamp_ms: int, seq: int | None = None) -> bytes:
    """A payload; NDEATH has no `seq`."""
    body = _varint_field(_TIMESTAMP, timestamp_ms)
    for metric in metrics:
        body += _bytes_field(_METRICS, _metric(metric, timestamp_ms))
    return body if seq is None else body + _varint_field(_SEQ, seq)


def decode(payload: bytes) -> list[Metric]:
    """The metrics of a command. Raises ValueError for what is no payload."""
    found: list[Metric] = []
    for number, value in _fields(payload):
        if number == _METRICS:
            if not isinstance(value, bytes) or len(found) >= _MOST_METRICS:
                raise ValueError("not a payload of Sparkplug B")
            found.append(_read_metric(value))
    return found


def _metric(metric: Metric, timestamp_ms: int) -> bytes:
    body = b"" if metric.name is None else _bytes_field(_NAME, metric.name.encode())
    if metric.alias is not None:
        body += _varint_field(_ALIAS, metric.alias)
    body += _varint_field(_TIME, timestamp_ms) + _varint_field(_DATATYPE, metric.datatype)
    if metric.value is None:
        return body + _varint_field(_IS_NULL, 1)
    if metric.datatype == BOOLEAN:
        return body + _varint_field(_BOOLEAN, int(bool(metric.value)))
    if metric.datatype == DOUBLE:
        return body + _varint(_DOUBLE << 3 | 1) + struct.pack("<d", metric.value)
    return body + _varint_field(_LONG, int(metric.value))


def _read_metric(body: bytes) -> Metric:
    name: str | None = None
    alias: int | None = None
    datatype, value = 0, None
    for number, found in _fields(body):
        if number == _NAME and isinstance(found, bytes):
            name = found.decode()  # UnicodeDecodeError is a ValueError
        elif number == _ALIAS and isinstance(found, int):
            alias = found
        elif number == _DATATYPE and isinstance(found, int):
            datatype = found
        elif number == _BOOLEAN and isinstance(found, int):
            value = bool(found)
    return Metric(value, datatype, name, alias)


def _fields(body: bytes) -> Iterator[tuple[int, int | bytes]]:
    at = 0
    while at < len(body):
        key, at = _read_varint(body, at)
        wire = key & 7
        if wire == 0:
            value: int | bytes
            value, at = _read_varint(body, at)
        elif wire in (1, 5):
            size = 8 if wire == 1 else 4
            value, at = body[at : at + size], at + size
        elif wire == 2:
            size, at = _read_varint(body, at)
            value, at = body[at : at + size], at + size
        else:
            raise ValueError("not a payload of Sparkplug B")
        if at > len(body):
            raise ValueError("not a payload of Sparkplug B: cut off")
        yield key >> 3, value


def _read_varint(body: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(body):
            raise ValueError("not a payload of Sparkplug B: cut off")
        value |= (body[at] & 0x7F) << shift
        at += 1
        if not body[at - 1] & 0x80:
            return value, at
    raise ValueError("not a payload of Sparkplug B")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _varint_field(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _bytes_field(number: int, value: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(value)) + value
