"""Replay: the contract of its files, the same bytes each time, pictures, and errors in one line."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from pathlib import Path
from typing import Any

import av
import cv2
import jsonschema
import numpy as np
import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.schema import text
from lumpwatch.service.core.decision import RoiResult
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.core.video_writer import VideoWriter
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.offline.replay import ReplayError, run_replay
from lumpwatch.service.storage.prior_store import PriorStore
from tests.service_helpers import HEIGHT, INTERVAL_S, WIDTH, camera, frame, picture, prior, site_tree

FRAMES = 60
FILES = ("states.jsonl", "alarms.jsonl", "summary.json")


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def scene() -> list[Frame]:
    """An object from 1 s to 3 s, at 10 frames a second, on a clock that began long ago."""
    return [frame(k, bright=10 <= k < 30, time_s=5000.0 + k * INTERVAL_S) for k in range(FRAMES)]


def run(out: Path, frames: list[Frame] | None = None, listeners: tuple[Any, ...] = ()) -> Any:
    chosen = scene() if frames is None else frames
    return run_replay(
        "pit", camera(), {"apron": prior(version=2)}, chosen, "clip.mp4", out, listeners=listeners
    )


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay") / "deep" / "out"
    run(folder)
    return folder


def test_states_have_the_fields_of_the_contract(out: Path) -> None:
    states = lines(out / "states.jsonl")
    check = jsonschema.Draft202012Validator(json.loads(text("replay")))
    for one in states:
        check.validate(one)
    assert [one["frame"] for one in states] == list(range(1, FRAMES + 1))
    assert [one["time_s"] for one in states] == [round(k * 0.1, 6) for k in range(FRAMES)]
    assert {(one["camera"], one["roi"]) for one in states} == {("cam", "apron")}
    assert {one["state"] for one in states} == {"CLEAR", "LUMP"}
    contract = ["frame", "time_s", "camera", "roi", "state", "existence", "objects"]
    assert list(states[0]) == [*contract, "oversize", "unlocated", "feed", "blockage", "reason"]
    seen = [one["objects"][0] for one in states if one["objects"]]
    assert len(seen) > 10
    assert {"x", "y", "w", "h", "existence", "model", "id"} <= set(seen[0])
    middle = states[25]["objects"][0]
    assert abs(middle["x"] + middle["w"] / 2 - 48) < 5  # pixels of the whole picture
    assert abs(middle["y"] + middle["h"] / 2 - 32) < 5


def test_alarms_are_one_record_a_transition(out: Path) -> None:
    alarms, states = lines(out / "alarms.jsonl"), lines(out / "states.jsonl")
    check = jsonschema.Draft202012Validator(json.loads(text("alarm")))
    for one in alarms:
        check.validate(one)
    assert [one["data"]["change"] for one in alarms] == ["raised", "cleared"]
    raised, cleared = (one["data"] for one in alarms)
    assert 1.2 <= raised["time_s"] < cleared["time_s"]
    by_frame = {one["frame"]: one for one in states}
    assert by_frame[raised["frame"] - 1]["state"] == "CLEAR"
    assert by_frame[raised["frame"]]["state"] == "LUMP"
    assert by_frame[cleared["frame"]]["state"] == "CLEAR"
    assert alarms[0]["time"].startswith("1970-01-01T00:00:0")
    assert raised["prior"] == 2
    assert len({one["id"] for one in alarms}) == 2


def test_the_summary_counts_what_the_files_hold(out: Path) -> None:
    summary, states = json.loads((out / "summary.json").read_text()), lines(out / "states.jsonl")
    assert summary == {
        "site": "pit",
        "camera": "cam",
        "video": "clip.mp4",
        "frames": FRAMES,
        "duration_s": 5.9,
        "dropped": {},
        "rois": {
            "apron": {
                "frames": FRAMES,
                "paced": 0,
                "states": {name: sum(one["state"] == name for one in states) for name in ("CLEAR", "LUMP")},
                "blind": {},
                "alarms": {"cleared": 1, "raised": 1},
                "feed": dict(sorted(Counter(one["feed"]["state"] for one in states).items())),
                "highest_existence": max(one["existence"] for one in states),
                "prior": 2,
            }
        },
    }


def test_the_same_frames_give_the_same_bytes(out: Path, tmp_path: Path) -> None:
    run(tmp_path)
    later = [dataclasses.replace(one, wall_s=9e9) for one in scene()]
    run(tmp_path / "later", later)  # the wall clock leaves no trace
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()
        assert (tmp_path / "later" / name).read_bytes() == (out / name).read_bytes()


def test_frames_that_are_not_newer_are_counted(tmp_path: Path) -> None:
    frames = scene()
    summary = run(tmp_path, [*frames[:5], frames[4], frames[2], *frames[5:8]])
    assert dict(summary.dropped) == {"duplicate": 1, "late": 1}
    assert [one["frame"] for one in lines(tmp_path / "states.jsonl")] == list(range(1, 9))


def test_watchers_see_every_frame(tmp_path: Path) -> None:
    seen: list[tuple[int, str]] = []

    def watch(one: Frame, results: tuple[RoiResult, ...], pipeline: CameraPipeline) -> None:
        assert pipeline.detector("apron") is not None
        seen.extend((one.seq, result.roi) for result in results)

    run(tmp_path, scene()[:4], (watch,))
    assert seen == [(k, "apron") for k in range(4)]


def test_no_frame_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match=r"^clip\.mp4: holds no frame$"):
        run(tmp_path, [])


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(ReplayError, match=r"/file: cannot be written"):
        run(tmp_path / "file")
    (tmp_path / "out" / "states.jsonl").mkdir(parents=True)
    with pytest.raises(ReplayError, match=r"/out/states\.jsonl: cannot be written"):
        run(tmp_path / "out")


# The command


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a video, a configuration and a stored prior."""
    folder = tmp_path_factory.mktemp("site")
    with VideoWriter(folder / "clip.mp4", WIDTH, HEIGHT, 10.0) as writer:
        for k in range(FRAMES):
            writer.write(picture(bright=10 <= k < 30))
    (folder / "site.yaml").write_text(json.dumps(site_tree()), encoding="utf-8")
    PriorStore(folder / "var").save(prior())
    return folder


def command(clip: Path, out: Path, *more: str, video: str = "clip.mp4") -> int:
    return main(
        ["replay", str(clip / "site.yaml"), str(clip / video), "--camera", "cam", "--out", str(out), *more]
    )


def test_replaying_a_file_twice_gives_the_same_bytes(clip: Path, tmp_path: Path) -> None:
    assert command(clip, tmp_path / "a") == 0
    assert command(clip, tmp_path / "b", "--overlay", "--plot") == 0
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert (summary["frames"], summary["rois"]["apron"]["prior"]) == (FRAMES, 1)
    assert summary["rois"]["apron"]["alarms"] == {"cleared": 1, "raised": 1}
    with av.open(str(tmp_path / "b" / "overlay.mp4")) as video:
        frames = [one.to_ndarray(format="bgr24") for one in video.decode(video=0)]
    assert len(frames) == FRAMES
    assert frames[0].shape == (HEIGHT, WIDTH, 3)
    # Colour is drawn into a gray picture: the ROI's outline at least.
    assert all(np.ptp(one.astype(int), axis=2).max() > 40 for one in frames)
    plot = cv2.imread(str(tmp_path / "b" / "existence.png"))
    assert plot is not None
    assert min(plot.shape[:2]) > 100
    assert np.ptp(plot) > 100


@pytest.mark.parametrize(
    "length",
    [
        pytest.param(1),
        2,
    ],
)
def test_the_overlay_of_a_very_short_clip(clip: Path, tmp_path: Path, length: int) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k in range(length):
        cv2.imwrite(str(folder / f"{k}.png"), picture(bright=False))
    arguments = [str(clip / "site.yaml"), str(folder), "--camera", "cam", "--out", str(tmp_path / "out")]
    assert main(["replay", *arguments, "--overlay"]) == 0
    with av.open(str(tmp_path / "out" / "overlay.mp4")) as video:
        assert len(list(video.decode(video=0))) == length


@pytest.mark.parametrize(
    ("video", "reason"),
    [
        ("none.mp4", "none.mp4: no such file or folder"),
        ("site.yaml", "site.yaml: "),
        ("empty.mp4", "empty.mp4: the file is empty"),
        ("var", "var: 0 pictures"),
    ],
)
def test_a_video_that_cannot_be_used(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], video: str, reason: str
) -> None:
    (clip / "empty.mp4").touch()
    assert command(clip, tmp_path, video=video) == 1
    told = capsys.readouterr().err
    assert told.startswith("lumpwatch: ")
    assert reason in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize("more", [[], ["--overlay"]])
def test_results_that_cannot_be_written(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str]
) -> None:
    (tmp_path / "file").write_text("x")
    assert command(clip, tmp_path / "file", *more) == 1
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert "file: cannot be written" in told


@pytest.mark.parametrize(
    ("name", "flag"),
    [
        pytest.param("overlay.mp4", "--overlay"),
        ("existence.png", "--plot"),
    ],
)
def test_a_picture_that_cannot_be_written(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, flag: str
) -> None:
    (tmp_path / name).mkdir()
    assert command(clip, tmp_path, flag) == 1
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert name in told


def test_without_a_prior_a_histogram_is_refused(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "site.yaml").write_text(json.dumps(site_tree()), encoding="utf-8")
    arguments = [
        str(tmp_path / "site.yaml"),
        str(clip / "clip.mp4"),
        "--camera",
        "cam",
        "--out",
        str(tmp_path),
    ]
    assert main(["replay", *arguments]) == 2
    told = capsys.readouterr().err
    assert "camera cam, roi apron: likelihood kind histogram" in told
    assert len(told.splitlines()) == 1


def test_without_a_prior_lumps_are_found_with_stated_defaults(clip: Path, tmp_path: Path) -> None:
    tree = site_tree(likelihood={"kind": "lump"})
    (tmp_path / "site.yaml").write_text(json.dumps(tree), encoding="utf-8")
    arguments = [
        str(tmp_path / "site.yaml"),
        str(clip / "clip.mp4"),
        "--camera",
        "cam",
        "--out",
        str(tmp_path),
    ]
    assert main(["replay", *arguments]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["rois"]["apron"]["prior"] == 0
