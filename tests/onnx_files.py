"""ONNX files made by hand: one layer each, written in the wire format of protocol buffers.

Field numbers are those of onnx.proto3: ModelProto, GraphProto, NodeProto, TensorProto, ValueInfoProto.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_FLOAT, _INT, _INTS = 1, 2, 7


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    content = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _tensor(name: str, values: Sequence[int], numbers: np.ndarray) -> bytes:
    shape = b"".join(_number(1, side) for side in values)
    return shape + _number(2, _FLOAT) + _bytes(8, name) + _bytes(9, numbers.astype("<f4").tobytes())


def _value(name: str, shape: Sequence[int]) -> bytes:
    sides = b"".join(_bytes(1, _number(1, side)) for side in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, _FLOAT) + _bytes(2, sides)))


def _ints(name: str, values: Sequence[int]) -> bytes:
    return _bytes(1, name) + b"".join(_number(8, value) for value in values) + _number(20, _INTS)


def _model(node: bytes, initialisers: Sequence[bytes], given: bytes, result: bytes) -> bytes:
    graph = _bytes(1, node) + _bytes(2, "graph")
    graph += b"".join(_bytes(5, one) for one in initialisers)
    graph += _bytes(11, given) + _bytes(12, result)
    return _number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13))


def brightness_net(
    size: tuple[int, int], *, gain: float = 20.0, offset: float = -10.0, stride: int = 4, channels: int = 1
) -> bytes:
    """A mean over blocks of `stride` pixels: logit = gain * brightness (0 to 1) + offset.

    `size` is width and height of the picture it takes; both multiples of `stride`.
    """
    width, height = size
    kernel = np.full((1, channels, stride, stride), gain / (channels * stride * stride))
    node = b"".join(_bytes(1, name) for name in ("picture", "kernel", "offset"))
    node += _bytes(2, "logits") + _bytes(3, "mean") + _bytes(4, "Conv")
    node += _bytes(5, _ints("kernel_shape", (stride, stride))) + _bytes(5, _ints("strides", (stride, stride)))
    return _model(
        node,
        (_tensor("kernel", kernel.shape, kernel), _tensor("offset", (1,), np.array([offset]))),
        _value("picture", (1, channels, height, width)),
        _value("logits", (1, 1, height // stride, width // stride)),
    )


def classifier_net(size: tuple[int, int]) -> bytes:
    """A mean over the whole picture: one number in place of a map."""
    width, height = size
    node = _bytes(1, "picture") + _bytes(2, "score") + _bytes(3, "pool") + _bytes(4, "Flatten")
    return _model(node, (), _value("picture", (1, 1, height, width)), _value("score", (1, width * height)))
