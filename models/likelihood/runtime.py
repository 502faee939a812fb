"""Runs an ONNX model by ONNX Runtime on one thread: no pool competes with the threads of the process."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_ERRORS = 3
"""ONNX Runtime tells errors only: it warns of graphics cards that it finds no driver for."""


class OnnxModel:
    """A model of one input and one output, float32. The same input gives the same bytes on one machine."""

    def __init__(self, content: bytes) -> None:
        """`content`: the bytes of the model."""
        # Loaded with the first model: a process without one neither waits for it nor holds its memory.
        import onnxruntime

        onnxruntime.set_default_logger_severity(_ERRORS)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session: Any = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )
        self._input: str = self._session.get_inputs()[0].name

    def __call__(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """The output, a new array, for the input `x`."""
        return self._session.run(None, {self._input: x})[0]
