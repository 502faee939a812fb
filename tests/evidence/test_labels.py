"""Verdicts become clips and labels that training and backtests take."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.roi import make_roi
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli import main
from lumpwatch.service.core.crop import reduced_frame, whole_frame, working_luma
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.evidence.clip import write_video
from lumpwatch.service.evidence.files import write_files
from lumpwatch.service.evidence.store import EvidenceStore
from lumpwatch.service.offline.backtest.archive import archive
from lumpwatch.service.storage.event_log import EventLog, event_file
from lumpwatch.service.storage.event_notes import Verdict, VerdictOutcome
from lumpwatch.service.storage.label_file import read_labels
from lumpwatch.service.training.evidence_labels import track_labels
from lumpwatch.service.training.footage import read_footage
from tests.evidence.scene import Scene, moving
from tests.offline.shift_scene import entry
from tests.service_helpers import HEIGHT, WIDTH, camera, prior, site_tree

POLYGON = ((0.11, 0.13), (0.83, 0.21), (0.9, 0.94), (0.2, 0.77))


@given(st.integers(150, 400), st.integers(150, 400), st.sampled_from([24, 40, 64, 200]), st.integers(0, 99))
def test_a_region_cuts_the_same_from_the_whole_picture(
    width: int, height: int, working: int, seed: int
) -> None:
    data = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.uint8)
    roi = make_roi(POLYGON, width, height, working)
    frame = Frame(0, 0.0, 0.0, 0.0, width, height, "gray8", data)
    sent = reduced_frame(frame, [roi])
    again = whole_frame(sent)
    assert again.data.shape == (height, width)
    assert np.array_equal(working_luma(again, roi), working_luma(sent, roi))


def test_tracks_become_rows() -> None:
    def found(i: int, existence: float, x: float) -> dict[str, float]:
        return {"id": i, "existence": existence, "x": x, "y": 2.0, "w": 3.5, "h": 4.0}

    lines = [
        {"objects": [found(1, 0.6, 10.0)]},
        {"objects": [found(1, 0.95, 11.25), found(2, 0.89, 50.0)]},  # number 2 never gets above 0.9
        {"objects": []},
        {"objects": [found(1, 0.7, 12.0), found(3, 0.99, 60.0)]},
    ]
    text = track_labels("\n".join(json.dumps(line) for line in lines).encode(), camera())
    assert text.splitlines() == [
        "1,1,10,2,3.5,4,1,1,1",
        "2,1,11.25,2,3.5,4,1,1,1",
        "4,1,12,2,3.5,4,1,1,1",
        "4,3,60,2,3.5,4,1,1,1",
    ]


@pytest.fixture
def judged(tmp_path: Path) -> Path:
    """A site with four alarms: true, false, unsure, and one whose evidence is gone."""
    one = camera()
    scene = Scene(one, {"apron": prior()})
    scene.show(4.0, lambda k: moving(k, visible=False))
    scene.show(2.5, lambda k: moving(k, visible=True))
    store = EvidenceStore(tmp_path / "var")
    log = EventLog(event_file(tmp_path / "var", "cam"))
    said = [VerdictOutcome.TRUE, VerdictOutcome.FALSE, VerdictOutcome.UNSURE, VerdictOutcome.TRUE]
    for k, says in enumerate(said, start=1):
        name = f"{1_700_000_000_000 + k:015d}-{k:06d}"
        log.append([entry(k, "raised", k)])
        log.add(
            [
                Verdict(2.0, "apron", name, k, VerdictOutcome.UNSURE, "Eve"),
                Verdict(3.0, "apron", name, k, says, "Ada"),
            ]
        )
        clip = replace(scene.clips[0], trigger=replace(scene.clips[0].trigger, id=name, sequence=k))
        if k < 4:
            store.write(
                "cam", "apron", name, partial(write_files, clip=clip, site="pit", camera=one, software="1")
            )
    log.close()
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(site_tree() | {"store": {"path": str(tmp_path / "var")}}))
    return config


def test_labels_of_verdicts_are_taken_by_training_and_backtests(
    judged: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = judged.parent / "labelled"
    assert main(["labels", str(judged), "--from-verdicts", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert told.startswith("1 true and 1 false alarms in")
    assert "left out: 1 unsure, 0 without a track, 1 without evidence" in told
    (video,) = (out / "true").glob("*.mkv")
    (negative,) = (out / "false").glob("*.mkv")
    clips = archive([video, negative])
    assert [bool(clip.boxes) for clip in clips] == [True, False]
    boxes = read_labels(video.with_suffix(".txt"))
    frames, _ = read_frames(camera(), video)
    footage = read_footage(camera().rois[0], frames, boxes, lambda _: None)
    assert (footage.width, footage.height) == (WIDTH, HEIGHT)
    assert footage.count >= max(box.frame for box in boxes)
    assert footage.interval_s == pytest.approx(0.1, abs=0.01)
    # On the last frames the boxes lie on the square: 14 px wide, at columns 41 to 55.
    last = boxes[-1]
    assert abs(last.x + last.w / 2 - 48) < 5
    listed = json.loads((out / "verdicts.json").read_text())
    assert [(one["verdict"], one["by"]) for one in listed] == [("true", "Ada"), ("false", "Ada")]
    assert all((out / one["clip"]).is_file() and (out / one["labels"]).is_file() for one in listed)
    # A folder with content is not mixed with more.
    assert main(["labels", str(judged), "--from-verdicts", "--out", str(out)]) == 2
    assert "is not empty" in capsys.readouterr().err


def test_evidence_is_listed_shown_fetched_and_replayed_from_the_store(
    judged: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def run(*arguments: str, code: int = 0) -> str:
        assert main([*arguments]) == code
        out, err = capsys.readouterr()
        return out if code == 0 else err

    told = run("evidence", "list", str(judged))
    assert [line.split()[0] for line in told.splitlines()[1:]] == [
        f"{1_700_000_000_000 + k:015d}-{k:06d}" for k in (1, 2, 3)
    ]
    listed = [json.loads(line) for line in run("evidence", "list", str(judged), "--json").splitlines()]
    assert [one["verdict"] for one in listed] == ["true", "false", "unsure"]
    name = listed[1]["id"]
    assert json.loads(run("evidence", "show", str(judged), name)) == listed[1]
    copied = run(
        "evidence", "fetch", str(judged), f"cam/apron/{name}", "--out", str(tmp_path / "got")
    ).strip()
    told = run("replay", "--evidence", copied, "--out", str(tmp_path / "again"), "--plot", "--overlay")
    assert "the same decisions as live on all" in told
    assert (tmp_path / "again" / "existence.png").stat().st_size > 1000
    assert "is there already" in run(
        "evidence", "fetch", str(judged), name, "--out", str(tmp_path / "got"), code=1
    )
    states = Path(copied) / "states.jsonl"
    states.write_bytes(states.read_bytes()[:-9])
    assert "states.jsonl: is damaged" in run(
        "replay", "--evidence", copied, "--out", str(tmp_path / "x"), code=1
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["evidence", "show", "CONFIG"], "evidence show needs an ID"),
        (["evidence", "list", "CONFIG", "x"], "evidence list takes no ID"),
        (["evidence", "fetch", "CONFIG", "x"], "evidence fetch needs --out DIR"),
        (["replay", "--out", "x"], "config is missing"),
        (["replay", "CONFIG", "--evidence", "x", "--out", "x"], "leave them out"),
        (["verdict", "maybe", "CONFIG", "--camera", "cam", "--roi", "apron", "--by", "A"], "invalid choice"),
        (["report", "CONFIG", "--shift", "noon"], "is no shift"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(site_tree()))
    assert main([str(config) if one == "CONFIG" else one for one in arguments]) == 2
    assert told in capfd.readouterr().err


def test_clips_of_colour_pictures_are_read_in_colour(tmp_path: Path) -> None:
    pictures = [np.random.default_rng(k).integers(0, 256, (48, 62, 3)).astype(np.uint8) for k in range(3)]
    frames = [Frame(k, k / 10, k / 10, 0.0, 62, 48, "bgr8", one) for k, one in enumerate(pictures)]
    write_video(tmp_path / "clip.mkv", pictures, frames, "bgr24")
    with av.open(str(tmp_path / "clip.mkv")) as container:
        read = [one.to_ndarray(format="bgr24") for one in container.decode(video=0)]
    assert len(read) == 3
    assert all(np.array_equal(a, b) for a, b in zip(pictures, read, strict=True))
