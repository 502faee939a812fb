"""Writes a small convolutional net as an ONNX model, which `lumpwatch.models.likelihood.runtime` runs.

ONNX is a protobuf: a message is a row of fields, each a key (number of the field times 8, plus the kind of what
follows) and a whole number of variable length, or a length and as many bytes (onnx.proto3, opset 13).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOAT, _IR, _OPSET = 1, 8, 13
_ATTRIBUTE_INTS, _ATTRIBUTE_STRING = 7, 3

Shape = tuple[int | str, ...]
"""Of a tensor; a word stands for a size that is not fixed."""


class Graph:
    """A net while it is written; each method adds one operation to the tensor named and names the result."""

    def __init__(self, name: str, shape: Shape) -> None:
        """`name` and `shape` of what goes in."""
        self._nodes: list[bytes] = []
        self._constants: list[bytes] = []
        self._input = _value(name, shape)

    def conv(self, x: str, weight: NDArray[np.float32], bias: NDArray[np.float32], stride: int = 1) -> str:
        """Convolution with kernels (out, in, k, k), the border filled with zeros."""
        k = weight.shape[2]
        inputs = (x, self._constant(weight), self._constant(bias))
        pads, sides = [k // 2] * 4, [k, k]
        return self._node("Conv", inputs, kernel_shape=sides, strides=[stride, stride], pads=pads)

    def relu(self, x: str) -> str:
        """What is positive."""
        return self._node("Relu", (x,))

    def add(self, x: str, y: str) -> str:
        """The sum of two tensors of one shape."""
        return self._node("Add", (x, y))

    def doubled(self, x: str) -> str:
        """Every cell twice, along both axes."""
        factors = self._constant(np.array([1.0, 1.0, 2.0, 2.0], np.float32))
        return self._node(
            "Resize",
            (x, "", factors),
            mode="nearest",
            coordinate_transformation_mode="asymmetric",
            nearest_mode="floor",
        )

    def model(self, x: str, shape: Shape) -> bytes:
        """The finished model, with tensor `x` for its result."""
        graph = b"".join(_bytes(1, node) for node in self._nodes) + _bytes(2, b"net")
        graph += b"".join(_bytes(5, constant) for constant in self._constants)
        graph += _bytes(11, self._input) + _bytes(12, _value(x, shape))
        return _number(1, _IR) + _bytes(7, graph) + _bytes(8, _bytes(1, b"") + _number(2, _OPSET))

    def _constant(self, array: NDArray[np.float32]) -> str:
        name = f"c{len(self._constants)}"
        sizes = b"".join(_number(1, size) for size in array.shape)
        content = np.ascontiguousarray(array, np.float32).tobytes()
        self._constants.append(sizes + _number(2, _FLOAT) + _bytes(8, name.encode()) + _bytes(9, content))
        return name

    def _node(self, operation: str, inputs: tuple[str, ...], **attributes: list[int] | str) -> str:
        name = f"t{len(self._nodes)}"
        node = b"".join(_bytes(1, one.encode()) for one in inputs) + _bytes(2, name.encode())
        node += _bytes(4, operation.encode())
        node += b"".join(_bytes(5, _attribute(key, value)) for key, value in attributes.items())
        self._nodes.append(node)
        return name


def _attribute(name: str, value: list[int] | str) -> bytes:
    if isinstance(value, str):
        return _bytes(1, name.encode()) + _bytes(4, value.encode()) + _number(20, _ATTRIBUTE_STRING)
    numbers = b"".join(_number(8, one) for one in value)
    return _bytes(1, name.encode()) + numbers + _number(20, _ATTRIBUTE_INTS)


def _value(name: str, shape: Shape) -> bytes:
    sizes: Any = (_number(1, one) if isinstance(one, int) else _bytes(2, one.encode()) for one in shape)
    tensor = _number(1, _FLOAT) + _bytes(2, b"".join(_bytes(1, size) for size in sizes))
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, tensor))


def _number(field: int, value: int) -> bytes:
    return _variable(field << 3) + _variable(value)


def _bytes(field: int, content: bytes) -> bytes:
    return _variable(field << 3 | 2) + _variable(len(content)) + content


def _variable(value: int) -> bytes:
    """A whole number, seven bits a byte, the lowest first; the eighth says that more follow."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
