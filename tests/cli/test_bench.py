"""`lumpwatch bench` on a real clip, with a real bus."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lumpwatch.service.cli.camera_cost import USABLE, Cost
from tests.cli.test_cli import Captured, done, failed
from tests.servers.clips import write_clip

COST = Cost(1920, 1080, 25.0, 12.5, 4.0, 10.0, {"decode": 4.0}, shared_memory=True)


def test_the_arithmetic_by_hand() -> None:
    assert COST.ratio == 2.5
    assert COST.share == 0.25  # 25 frames of 10 ms
    assert USABLE == 0.8
    assert [COST.carried(processors) for processors in (1, 2, 8)] == [3, 6, 25]


def site_file(folder: Path, source: str) -> Path:
    """One region with a small untrained filter."""
    polygon = "[[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]"
    roi = f"{{id: apron, polygon: {polygon}, detector: {{kind: jdt, particles: 100}}}}"
    path = folder / "site.yaml"
    path.write_text(
        f"site: pit\nstore: {{path: {folder}/var}}\n"
        f"cameras:\n  - {{id: cam, source: {{url: {source}}}, rois: [{roi}]}}\n"
    )
    return path


def test_it_measures_the_chain_on_a_clip(tmp_path: Path, capsys: Captured) -> None:
    clip = write_clip(tmp_path / "clip.mp4", frames=50, fps=25.0)
    told = json.loads(done(capsys, "bench", site_file(tmp_path, str(clip)), "--for", "2s", "--json"))
    cost = told["cameras"]["cam"]
    assert (cost["width"], cost["height"], cost["fps"]) == (96, 64, pytest.approx(25.0))
    assert cost["decided_hz"] == pytest.approx(12.5, abs=1.0)  # every second frame, at 10 a second or more
    assert sum(cost["stages_ms"].values()) == pytest.approx(cost["frame_ms"], rel=0.01)
    assert cost["stages_ms"]["filter"] > cost["stages_ms"]["cut"] > 0.0
    assert cost["ratio"] == pytest.approx(cost["frame_ms"] / cost["decoding_ms"])
    assert cost["ratio"] > 1.0
    assert told["machine_share"] == pytest.approx(cost["processor_share"] / told["processors"])
    assert "memory" in told["not_measured"]


def test_what_cannot_be_measured_is_said(tmp_path: Path, capsys: Captured) -> None:
    site = site_file(tmp_path, str(tmp_path / "none.mp4"))
    assert "no such file" in failed(capsys, "bench", site, code=1)
    assert "expected 2s to 10m" in failed(capsys, "bench", site, "--for", "1s", code=2)
    short = write_clip(tmp_path / "short.mp4", frames=5)
    assert "too few" in failed(capsys, "bench", site, "--video", short, code=1)
