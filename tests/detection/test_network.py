"""A network of the user's own as likelihood: what it says of boxes, what is refused, and a replay."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.likelihood import NetworkLikelihood
from lumpwatch.models.likelihood.network import NetworkError, OnnxScoreMap
from lumpwatch.models.roi import View
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.service.cli import main
from lumpwatch.service.config import NetworkConfig, load_config
from lumpwatch.service.detection import network
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.network import make_network
from lumpwatch.service.errors import ConfigError
from tests.onnx_files import brightness_net, classifier_net
from tests.service_helpers import INTERVAL_S, frame, site_tree


def view_of(gray: np.ndarray, inside: np.ndarray | None = None) -> View:
    mask = np.ones(gray.shape) if inside is None else inside
    return View(gray, None, np.pad(mask.cumsum(0).cumsum(1), ((1, 0), (1, 0))).astype(np.int32))


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    states = blank(len(rows))
    states[:, [X, Y, W, H]] = rows
    return states


def test_scores_by_hand() -> None:
    """A map of the picture's own size: 2 inside a square of 8, -1 around it."""
    logits = np.full((32, 40), -1.0, np.float32)
    logits[8:16, 16:24] = 2.0
    likelihood = NetworkLikelihood(lambda gray: logits, 0.5, 0.5, 3.0)
    seen = likelihood.observe(view_of(np.zeros((32, 40), np.uint8)))
    states = boxes((20, 12, 8, 8), (8, 24, 8, 8), (20, 12, 4, 4), (20, 12, 16, 16))
    # The ring of a box is 1.5 times as large. Of 4 x 4 it is all 2; of 16 x 16 (24 x 20 in the picture) -1.
    assert seen.score(states) == pytest.approx([2.0 - 0.5, -1.0 - 0.5, 0.0, (64 * 2 - 192) / 256 - 0.5])
    assert seen.log_ratio(states)[:2] == pytest.approx([0.75, -0.75])


def test_ratios_are_bounded_and_boxes_outside_the_polygon_are_no_objects() -> None:
    inside = np.zeros((32, 40))
    inside[:, :20] = 1
    likelihood = NetworkLikelihood(lambda gray: np.full((4, 5), 50.0, np.float32), -100.0, 1.0, 3.0)
    seen = likelihood.observe(view_of(np.zeros((32, 40), np.uint8), inside))
    within, without, half = boxes((8, 8, 8, 8), (32, 8, 8, 8), (20, 8, 8, 8))
    states = np.array([within, without, half])
    assert list(np.isfinite(seen.score(states))) == [True, False, False]
    assert list(seen.log_ratio(states)) == [0.0, -3.0, -3.0]  # 50 inside and around: no contrast


def test_a_map_of_any_stride_covers_the_picture() -> None:
    gray = np.zeros((64, 96), np.uint8)
    gray[16:48, 32:64] = 255
    scores = []
    for stride, size in ((2, None), (8, None), (4, (48, 32))):
        net = OnnxScoreMap(brightness_net(size or (96, 64), stride=stride), size)
        seen = NetworkLikelihood(net, 0.0, 1.0, 9.0).observe(view_of(gray))
        scores.append(seen.score(boxes((48, 32, 32, 32), (16, 16, 24, 24), (48, 32, 64, 56))))
    right, away, large = np.array(scores).T
    assert (right > 5.0).all()
    assert (away < -9.0).all()
    assert (large < right - 5.0).all()


def test_the_network_sees_grey_levels_times_the_scale() -> None:
    """logit = 20 * brightness - 10, and OpenCV runs the file as it was meant."""
    for channels in (1, 3):
        net = OnnxScoreMap(brightness_net((16, 8), channels=channels), channels=channels)
        for level in (0, 51, 255):
            assert net(np.full((8, 16), level, np.uint8)) == pytest.approx(20 * level / 255 - 10, abs=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e7])
def test_numbers_that_are_no_logits(value: float) -> None:
    likelihood = NetworkLikelihood(lambda gray: np.full((4, 4), value, np.float32), 0.0, 1.0, 3.0)
    with pytest.raises(NetworkError, match="no logits"):
        likelihood.observe(view_of(np.zeros((32, 40), np.uint8)))


def configured(folder: Path, **network: Any) -> Path:
    detector = {"likelihood": {"kind": "network", "model": "own.onnx"} | network, "size_h": [0.2, 0.5]}
    path = folder / "site.yaml"
    path.write_text(json.dumps(site_tree(**detector)))
    return path


def network_of(path: Path) -> Any:
    return load_config(path).cameras[0].rois[0].detector.likelihood  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, r"own\.onnx: cannot be read"),
        (b"", "own.onnx: is not an ONNX network"),
        (b"not a network at all", "own.onnx: is not an ONNX network"),
        (brightness_net((96, 64))[:80], "own.onnx: is not an ONNX network"),
        (classifier_net((96, 64)), r"own\.onnx: .*\(1, 6144\)"),
        (brightness_net((96, 64), offset=float("nan")), r"own\.onnx: .*no logits"),
    ],
    ids=["missing", "empty", "text", "truncated", "classifier", "not-finite"],
)
def test_what_cannot_be_used_is_named(
    content: bytes | None,
    reason: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("clip.mp4").touch()
    if content is not None:
        (tmp_path / "own.onnx").write_bytes(content)
    path = configured(tmp_path, input_px=[96, 64])
    with pytest.raises(ConfigError, match=reason):
        make_network(network_of(path))
    assert main(["check", str(path)]) == 2
    told = capfd.readouterr().err
    assert told.startswith("lumpwatch: camera cam, roi apron: likelihood kind network: ")
    assert len(told.splitlines()) == 1


def test_a_relative_path_counts_from_the_configuration(tmp_path: Path) -> None:
    assert network_of(configured(tmp_path)).model == tmp_path / "own.onnx"
    assert network_of(configured(tmp_path, model="/nets/own.onnx")).model == Path("/nets/own.onnx")


def test_the_bright_object_is_found(tmp_path: Path) -> None:
    """The whole pipeline, without a prior: nothing before the object, then the object where it is."""
    (tmp_path / "own.onnx").write_bytes(brightness_net((72, 48)))
    camera = load_config(configured(tmp_path)).cameras[0]
    pipeline = CameraPipeline(camera)
    existence = []
    for k in range(60):
        picture = np.full((64, 96), 20, np.uint8)
        if k >= 30:
            picture[12 + k // 3 : 28 + k // 3, 40:56] = 250
        (result,) = pipeline.process(frame(k, data=picture), k * INTERVAL_S)
        existence.append(result.existence)
    assert max(existence[5:30]) < 0.2
    assert min(existence[45:]) > 0.9
    assert result.detection is not None
    found = max(result.detection.objects, key=lambda one: one.existence)
    assert found.x + found.w / 2 == pytest.approx(48, abs=4)
    assert found.y + found.h / 2 == pytest.approx(20 + 59 // 3, abs=4)
    assert found.w == pytest.approx(16, rel=0.35)


def test_a_network_that_ends_the_process_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What kills the process that reads it kills a child, and is told."""
    model = tmp_path / "net.onnx"
    model.write_bytes(brightness_net((320, 240)))
    config = NetworkConfig(kind="network", model=model)
    assert isinstance(make_network(config, apart=True), NetworkLikelihood)
    monkeypatch.setattr(network, "_CODE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(ConfigError, match=r"net\.onnx: is damaged: reading it ends the process \(SIGSEGV\)"):
        make_network(config, apart=True)
    monkeypatch.setattr(network, "_CODE", "raise MemoryError")
    with pytest.raises(ConfigError, match="is damaged, or needs more than"):
        make_network(config, apart=True)


@pytest.mark.slow
def test_networks_with_a_byte_turned_over_end_no_process_of_ours(tmp_path: Path) -> None:
    whole = bytearray(brightness_net((320, 240)))
    rng = np.random.default_rng(4)
    for k in range(8):
        torn = bytearray(whole)
        for at in rng.integers(0, len(torn), 3):
            torn[at] ^= 1 << int(rng.integers(8))
        model = tmp_path / f"{k}.onnx"
        model.write_bytes(torn)
        with contextlib.suppress(ConfigError):
            make_network(NetworkConfig(kind="network", model=model), apart=True)
