"""The net: each operation against plain NumPy, the picture's normalisation, and that it says the same every time."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.likelihood import onnx
from lumpwatch.models.likelihood.net import HEADS, SHAPES, STRIDE, Net, normalised
from lumpwatch.models.likelihood.runtime import OnnxModel
from tests.models.net_helpers import random_weights

Array = NDArray[np.float32]


def naive_conv(x: Array, weight: Array, bias: Array, stride: int) -> NDArray[np.float64]:
    """Convolution of (in, h, w), one product after the other."""
    out, _, k, _ = weight.shape
    half = k // 2
    wide = np.pad(x.astype(float), ((0, 0), (half, half), (half, half)))
    rows, columns = range(0, x.shape[1], stride), range(0, x.shape[2], stride)
    result = np.empty((out, len(rows), len(columns)))
    for o in range(out):
        for i, r in enumerate(rows):
            for j, c in enumerate(columns):
                result[o, i, j] = (wide[:, r : r + k, c : c + k] * weight[o]).sum() + bias[o]
    return result


def run(content: bytes, x: Array) -> Array:
    return OnnxModel(content)(x[None])[0]


def by_opencv(content: bytes, x: Array) -> Array:
    net = cv2.dnn.readNetFromONNX(np.frombuffer(content, np.uint8))
    net.setInput(x[None])
    return np.asarray(net.forward())[0]


@pytest.mark.parametrize(("k", "stride"), [(1, 1), (3, 1), (3, 2)])
def test_convolution(k: int, stride: int) -> None:
    rng = np.random.default_rng(k + stride)
    weight, bias = (rng.normal(size=shape).astype(np.float32) for shape in ((5, 3, k, k), (5,)))
    x = rng.normal(size=(3, 8, 12)).astype(np.float32)
    graph = onnx.Graph("x", ("n", 3, "h", "w"))
    content = graph.model(graph.conv("x", weight, bias, stride), ("n", 5, "h", "w"))
    assert run(content, x) == pytest.approx(naive_conv(x, weight, bias, stride), abs=1e-4)
    assert by_opencv(content, x) == pytest.approx(naive_conv(x, weight, bias, stride), abs=1e-4)


def test_other_operations() -> None:
    x = np.random.default_rng(0).normal(size=(2, 4, 6)).astype(np.float32)
    graph = onnx.Graph("x", ("n", 2, "h", "w"))
    content = graph.model(graph.doubled(graph.add("x", graph.relu("x"))), ("n", 2, "h", "w"))
    expected = np.repeat(np.repeat(x + np.maximum(x, 0), 2, axis=1), 2, axis=2)
    assert run(content, x) == pytest.approx(expected, abs=1e-6)
    assert by_opencv(content, x) == pytest.approx(expected, abs=1e-6)


def naive_net(weights: dict[str, Array], x: Array) -> NDArray[np.float64]:
    """The whole net, by the naive convolution."""

    def layer(name: str, y: NDArray[np.float64], stride: int = 1) -> NDArray[np.float64]:
        return naive_conv(y.astype(np.float32), weights[f"{name}_weight"], weights[f"{name}_bias"], stride)

    def bent(name: str, y: NDArray[np.float64], stride: int = 1) -> NDArray[np.float64]:
        return np.maximum(layer(name, y, stride), 0.0)

    def doubled(y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.repeat(np.repeat(y, 2, axis=1), 2, axis=2)

    y = bent("stem", x.astype(float))
    fine = y + bent("fine", y)
    y = bent("down", fine, 2)
    middle = y + bent("middle", y)
    y = bent("deeper", middle, 2)
    for name in ("deep0", "deep1", "deep2"):
        y = y + bent(name, y)
    deep = y
    y = bent("deepest", deep, 2)
    for name in ("deepest0", "deepest1"):
        y = y + bent(name, y)
    y = deep + doubled(layer("rise", y))
    y = y + bent("gathered", y)
    y = middle + doubled(layer("up", y))
    y = y + bent("joined", y)
    y = fine + doubled(layer("upper", y))
    return layer("heads", y + bent("finish", y))


def test_the_net_against_the_naive_one() -> None:
    weights = random_weights(1)
    gray = np.random.default_rng(1).integers(0, 256, (32, 64)).astype(np.uint8)
    expected = naive_net(weights, normalised(gray))
    assert Net(weights)(gray) == pytest.approx(expected, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.integers(8, 70), st.integers(8, 70))
def test_maps_cover_pictures_of_any_size(h: int, w: int) -> None:
    gray = np.random.default_rng(0).integers(0, 256, (h, w)).astype(np.uint8)
    maps = Net(random_weights(0))(gray)
    assert maps.shape == (len(HEADS), -(-h // STRIDE), -(-w // STRIDE))
    assert np.isfinite(maps).all()


def test_the_same_picture_gives_the_same_bytes_whatever_came_before() -> None:
    rng = np.random.default_rng(2)
    one, other = (rng.integers(0, 256, (60, 80)).astype(np.uint8) for _ in range(2))
    net = Net(random_weights(3))
    first = net(one).tobytes()
    net(other)
    net(other[:40, :50].copy())
    assert net(one).tobytes() == first
    assert Net(random_weights(3))(one).tobytes() == first


def test_blocks_become_channels() -> None:
    """Four pixels of the halved picture, row by row, lie in the four channels of one cell."""
    gray = np.zeros((32, 32), np.uint8)
    gray[4:6, 10:12] = 255  # halved: row 2, column 5; the cell in row 1, column 2, lower... upper right pixel
    folded = normalised(gray)
    assert folded.shape == (4, 8, 8)
    assert [int(k) for k in np.unravel_index(folded.argmax(), folded.shape)] == [1, 1, 2]


@pytest.mark.parametrize(("gain", "shift"), [(0.5, 20.0), (1.6, -30.0)])
def test_light_changes_little(gain: float, shift: float) -> None:
    """Local mean and contrast are taken out; what is left of a change of light is the constant that keeps flat
    pictures finite, and rounding."""
    rng = np.random.default_rng(4)
    gray = cv2.GaussianBlur(rng.normal(100.0, 60.0, (96, 128)).astype(np.float32), (0, 0), 2.0)
    before = normalised(np.clip(gray, 0, 255).astype(np.uint8))
    after = normalised(np.clip(gray * gain + shift, 0, 255).astype(np.uint8))
    assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.99
    assert after.std() == pytest.approx(before.std(), rel=0.3)


def test_a_flat_picture_is_nothing() -> None:
    assert np.array_equal(normalised(np.full((32, 32), 90, np.uint8)), np.zeros((4, 8, 8)))


@pytest.mark.parametrize("name", SHAPES)
def test_a_layer_of_another_shape_is_refused(name: str) -> None:
    weights = random_weights(0)
    weights[f"{name}_bias"] = weights[f"{name}_bias"][1:]
    with pytest.raises(ValueError, match=name):
        Net(weights)
