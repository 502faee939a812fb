"""A tracker's prior: sizes by row and the motion prior, learned, stored, and used in a replay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config import load_config
from lumpwatch.service.storage.prior_store import PriorStore
from tests import street

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "detector",
    [
        "{kind: imm_pf, models: [constant_velocity, motion_prior], size_h: [0.5, 0.9]}",
        "{kind: jpda, size_h: [0.5, 0.9], one_way: {direction: [1, 0]}}",
    ],
    ids=["imm_pf", "jpda"],
)
def test_what_is_learned_decides_and_the_tracks_fit_the_labels(
    detector: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sizes of the configuration are wrong on purpose: the prior's are right."""
    clip, labels = street.write(tmp_path / "street.mp4", 20.0), tmp_path / "gt.txt"
    labels.write_text(street.labels(20.0))
    site = tmp_path / "site.yaml"
    site.write_text(
        f"""\
site: test
store: {{path: {tmp_path / "var"}}}
cameras:
  - id: gate
    source: {{url: "{clip}"}}
    rois: [{{id: road, polygon: [[0, 0], [1, 0], [1, 1], [0, 1]], detector: {detector}}}]
"""
    )
    if "motion_prior" in detector:
        assert main(["check", str(site)]) == 2
        assert "motion_prior needs a prior" in capsys.readouterr().err
    where = ["--camera", "gate"]
    assert main(["train", str(site), str(clip), str(labels), *where, "--roi", "road"]) == 0
    prior = PriorStore(load_config(site).store.path).current("gate", "road").prior
    assert prior is not None
    assert (prior.learned.cells is not None) == ("motion_prior" in detector)
    assert main(["replay", str(site), str(clip), *where, "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "states.jsonl"), str(labels), "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    print(scores)
    assert scores["recall"] > 0.6
    assert scores["precision"] > 0.7
    assert scores["id_switches"] == 0
