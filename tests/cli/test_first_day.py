"""The first day at a site: a configuration from questions, a look at the camera, stills, clips, and drawn geometry."""

from __future__ import annotations

import io
import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.init import answers, configuration
from lumpwatch.service.config import load_config, parse_config
from lumpwatch.service.errors import ConfigError
from tests.cli.test_cli import Captured, done, failed
from tests.servers.clips import write_clip
from tests.servers.process import RtspServer
from tests.service_helpers import site_tree

GEOMETRY = {
    "width": {
        "far": [[0.32, 0.20], [0.68, 0.20]], "near": [[0.16, 0.70], [0.84, 0.70]], "width_mm": 2400, "view_deg": 58,
    },
    "lip": [[0.15, 0.77], [0.85, 0.77]],
    "limit_mm": 600,
}  # fmt: skip


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """A configuration as `init` writes it."""
    path = tmp_path / "site.yaml"
    assert main(["init", str(path), "--defaults"]) == 0
    return path


def test_init_writes_what_check_takes_and_overwrites_nothing(capsys: Captured, simulated: Path) -> None:
    capsys.readouterr()
    assert "configuration is valid" in done(capsys, "check", simulated)
    assert "exists" in failed(capsys, "init", simulated, code=2)


def test_five_questions_are_asked_and_their_answers_stand_in_the_file() -> None:
    asked: list[str] = []

    def ask(question: str, usual: str) -> str:
        asked.append(question)
        return {"Name of the site": "south"}.get(question, "750" if "mm" in question else "")

    found = answers({"camera": "belt-2"}, ask)
    assert len(asked) == 4  # the camera was given
    config = parse_config(configuration("site.yaml", found))
    assert (config.site, config.cameras[0].id, config.cameras[0].rois[0].id) == ("south", "belt-2", "apron")
    assert "limit_mm: 750" in configuration("site.yaml", found)


def test_answers_may_come_by_standard_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("south\n\nsim:feed?fps=12\n"))
    path = tmp_path / "site.yaml"
    assert main(["init", str(path)]) == 0
    config = parse_config(path.read_text())
    camera = config.cameras[0]
    assert (config.site, camera.id, camera.source.address) == ("south", "crusher-1", "sim:feed?fps=12")
    assert camera.rois[0].id == "apron"  # after the last line: what is usual


@pytest.mark.parametrize("wrong", [{"limit_mm": "six"}, {"site": "no spaces please"}, {"source": "http://x"}])
def test_an_answer_that_cannot_stand_there_is_refused(wrong: dict[str, str]) -> None:
    with pytest.raises(ConfigError):
        configuration("site.yaml", answers(dict(wrong), None))


def test_a_still_and_a_clip(capsys: Captured, simulated: Path, tmp_path: Path) -> None:
    still, clip = tmp_path / "still.png", tmp_path / "clip.mp4"
    capsys.readouterr()
    told = json.loads(done(capsys, "snapshot", simulated, "--out", still, "--json"))
    assert (told["width"], told["height"], told["file"]) == (640, 480, str(still))
    picture = cv2.imread(str(still))
    assert picture is not None
    assert picture.shape == (480, 640, 3)
    done(capsys, "record", simulated, "--for", "400ms", "--out", clip)
    with av.open(str(clip)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 6  # 15 frames a second
    assert "exists" in failed(capsys, "record", simulated, "--out", clip, code=2)
    assert "say the unit: 2s or 2m" in failed(
        capsys, "record", simulated, "--for", "2", "--out", clip, code=2
    )
    assert ".png or .jpg" in failed(capsys, "snapshot", simulated, "--out", tmp_path / "a.xyz", code=2)


def test_geometry_is_drawn_on_a_picture_and_told_in_figures(capsys: Captured, tmp_path: Path) -> None:
    tree = site_tree(likelihood={"kind": "lump"})
    tree["cameras"][0]["source"]["url"] = "sim:feed"
    tree["cameras"][0]["rois"][0]["calibration"] = GEOMETRY
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(tree))
    still, drawn = tmp_path / "a.png", tmp_path / "drawn.png"
    cv2.imwrite(str(still), np.full((480, 640, 3), 90, np.uint8))
    told = json.loads(done(capsys, "check", config, "--picture", still, "--out", drawn, "--json"))
    view = told["rois"][0]["calibration"]
    assert 2.0 < view["camera_height_m"] < 3.0
    assert view["limit_far_px"] < view["limit_near_px"]
    # Pictures as the source sends them are those that are meant; without them a size is assumed, and said.
    asked = json.loads(done(capsys, "check", config, "--connect", "--json"))
    assert asked["rois"][0]["calibration"] == view
    assert not any("assumed" in line for line in asked["lines"])
    assert "cam: 640x480, 15 frames a second stated" in asked["lines"]
    assert "1920x1080 assumed" in done(capsys, "check", config).replace("\n", " ")
    picture = cv2.imread(str(drawn))
    assert picture is not None
    assert (picture != 90).any()
    assert "is no picture" in failed(capsys, "check", config, "--picture", config, code=2)


def test_a_source_that_is_no_file_does_not_pass(capsys: Captured, tmp_path: Path) -> None:
    config = tmp_path / "site.yaml"
    tree = site_tree(likelihood={"kind": "lump"})
    tree["cameras"][0]["source"]["url"] = str(tmp_path / "none.mp4")
    config.write_text(json.dumps(tree))
    assert "none.mp4: no such file" in failed(capsys, "check", config, code=2)


def test_a_camera_is_opened_and_what_it_sends_is_told(capsys: Captured, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    write_clip(clip, frames=60, fps=10.0)
    with RtspServer(clip) as server:
        tree = site_tree(likelihood={"kind": "lump"})
        tree["cameras"][0]["source"]["url"] = server.url
        config = tmp_path / "site.yaml"
        config.write_text(json.dumps(tree))
        still = tmp_path / "still.png"
        told = json.loads(done(capsys, "check", config, "--connect", "--out", still, "--json"))
        sent = told["sources"]["cam"]
        assert sent["codec"] == "h264"
        assert sent["fps"] == pytest.approx(10.0, rel=0.1)
        assert sent["clock_rate"] == pytest.approx(1.0, abs=0.1)
        assert sent["key_frame_s"] is not None
        assert still.stat().st_size > 100
        done(capsys, "record", config, "--for", "1s", "--out", tmp_path / "copy.mp4")
    with av.open(str(tmp_path / "copy.mp4")) as container:
        assert 8 <= sum(1 for _ in container.decode(video=0)) <= 12
    assert "camera cam" in failed(capsys, "check", config, "--connect", code=1)


def test_work_on_files_needs_no_secret_of_a_camera(tmp_path: Path) -> None:
    config = tmp_path / "site.yaml"
    tree = site_tree(likelihood={"kind": "lump"})
    tree["cameras"][0]["source"]["url"] = "rtsp://u:${NOT_SET}@h/x"
    config.write_text(json.dumps(tree))
    with pytest.raises(ConfigError, match="NOT_SET is not set"):
        load_config(config, {})
    assert load_config(config, {}, secrets=False).site == "pit"
    tree["cameras"][0]["rois"][0]["detector"]["likelihood"] = {"kind": "network", "model": "${NET}"}
    config.write_text(json.dumps(tree))
    with pytest.raises(ConfigError, match="NET is not set"):
        load_config(config, {}, secrets=False)


def test_the_only_camera_and_region_need_not_be_named(capsys: Captured, simulated: Path) -> None:
    capsys.readouterr()
    done(capsys, "priors", "list", simulated)
    text = simulated.read_text()
    other = "      - id: spout\n        polygon: [[0.1, 0.1], [0.2, 0.1], [0.2, 0.2]]\n"
    simulated.write_text(text.replace("      - id: apron", f"{other}      - id: apron"))
    assert "--roi is needed to choose one of spout, apron" in failed(
        capsys, "priors", "list", simulated, code=2
    )
