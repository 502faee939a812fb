"""Backtests from files on: archives, recordings, executors, the command, its files and its failures."""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from lumpwatch.service.batch import Progress, Task
from lumpwatch.service.cli import main
from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import load_config
from lumpwatch.service.core.alarm import Change
from lumpwatch.service.core.video_writer import VideoWriter
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.offline.backtest.archive import Clip, archive
from lumpwatch.service.offline.backtest.curve import Terms
from lumpwatch.service.offline.backtest.episodes import spans
from lumpwatch.service.offline.backtest.record import (
    Recording,
    Setup,
    Watch,
    decode_recording,
    encode_recording,
    finished_recordings,
    record_frames,
    record_video,
    tasks_of,
)
from lumpwatch.service.offline.backtest.report import as_record, write_backtest
from lumpwatch.service.offline.backtest.run import Backtest, run_backtest
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.label_file import LabelError
from lumpwatch.service.storage.prior_store import PriorStore, read_file
from tests.reproduction.lumps import announcements, read_states
from tests.service_helpers import HEIGHT, WIDTH, camera, frame, picture, prior, site, site_tree

Captured = pytest.CaptureFixture[str]
SQUARE = "41,25,14,14"
FALL = 25
"""The first frame whose label is the fall."""


def write_clip(folder: Path, name: str, bright: range, frames: int = 40) -> Path:
    """A video at ten frames a second with a bright square in some frames, and its labels."""
    path = folder / f"{name}.mp4"
    with VideoWriter(path, WIDTH, HEIGHT, 10.0) as video:
        for k in range(frames):
            video.write(picture(bright=k in bright))
    lines = [f"{k + 1},1,{SQUARE},1,1,1,{'fall' if k + 1 >= FALL else 'belt'}\n" for k in bright]
    path.with_suffix(".txt").write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two videos, one with a lump from frame 6 to 30, and a configuration with a prior that knows it."""
    made = tmp_path_factory.mktemp("archive")
    write_clip(made, "lump", range(5, 30))
    write_clip(made, "quiet", range(0))
    (made / "site.yaml").write_text(json.dumps(site_tree()), encoding="utf-8")
    PriorStore(made / "var").save(prior())
    return made


def setup(name: str = "site.yaml", **detector: Any) -> Setup:
    return Setup(name, camera(**detector), prior(version=1))


def clips(folder: Path) -> tuple[Clip, ...]:
    return archive([folder / "lump.mp4", folder / "quiet.mp4"])


def run(
    folder: Path, *setups: Setup, workers: int = 1, told: Callable[[Progress], None] = lambda _: None
) -> Backtest:
    with ThreadPoolExecutor(workers) as threads:
        return run_backtest(
            setups or (setup(),), clips(folder), Terms(), "fall", threads, lambda: workers, told=told
        )


def failed(capsys: Captured, *arguments: object, code: int) -> str:
    """The only line on standard error of a call that fails with this code."""
    assert main(["backtest", *map(str, arguments)]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    return err


# Archives


def test_labels_lie_beside_their_video_or_are_named_in_order(tmp_path: Path) -> None:
    videos = [tmp_path / "a.mp4", tmp_path / "sub" / "b.mp4"]
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.txt").write_text("1,1,0,0,5,5\n")
    (tmp_path / "sub" / "gt.txt").write_text("\n# no lump\n")
    one, two = archive(videos)
    assert [(c.name, c.labels, len(c.boxes)) for c in (one, two)] == [
        ("a.mp4", tmp_path / "a.txt", 1),
        ("b.mp4", tmp_path / "sub" / "gt.txt", 0),
    ]
    one, two = archive(videos, [two.labels or videos[0], one.labels or videos[0]])
    assert [len(one.boxes), len(two.boxes)] == [0, 1]
    (tmp_path / "a.txt").unlink()
    assert archive(videos, unlabelled_is_empty=True)[0] == Clip("a.mp4", videos[0], None, ())


def test_videos_of_one_name_carry_their_folders(tmp_path: Path) -> None:
    videos = [tmp_path / "x" / "a.mp4", tmp_path / "y" / "a.mp4", tmp_path / "b.mp4"]
    names = [clip.name for clip in archive(videos, unlabelled_is_empty=True)]
    assert names == [str(videos[0]), str(videos[1]), "b.mp4"]


def test_what_is_no_archive(tmp_path: Path) -> None:
    a, b, labels = tmp_path / "a.mp4", tmp_path / "b.mp4", tmp_path / "gt.txt"
    with pytest.raises(ConfigError, match=r"a\.mp4: .*a\.txt.*gt\.txt"):
        archive([a])
    with pytest.raises(ConfigError, match="1 for 2 videos"):
        archive([a, b], [labels])
    with pytest.raises(ConfigError, match=r"a\.mp4 .*more than once"):
        archive([a, b, a])
    with pytest.raises(LabelError, match=r"gt\.txt: cannot be read"):
        archive([a], [labels], unlabelled_is_empty=True)
    labels.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LabelError, match=r"gt\.txt: is not text"):
        archive([a], [labels])
    labels.write_text("1,1,0\n")
    with pytest.raises(LabelError, match=r"gt\.txt, line 1: expected"):
        archive([a])
    labels.write_text("1,1,0,0,5,5\n")
    with pytest.raises(ConfigError, match=r"gt\.txt: .*a\.mp4 and b\.mp4"):
        archive([a, b])


def test_a_folder_stands_for_the_videos_in_it(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "1.png").write_bytes(b"")
    (tmp_path / "images" / "gt.txt").write_text("")
    names = [clip.name for clip in archive([folder, tmp_path / "images"], None, True)]
    assert names == ["lump.mp4", "quiet.mp4", "images"]


# Recordings


def test_a_recording_gives_the_alarms_of_the_pipeline() -> None:
    """At the configured threshold; the pipeline's alarm latches, which moves neither raise nor clear."""
    frames = [frame(k, bright=k in (*range(10, 30), *range(50, 70)), time_s=50 + k / 10) for k in range(90)]
    config, pipeline = camera(), CameraPipeline(camera(), {"apron": prior()})
    changes: dict[Change, list[int]] = {Change.RAISED: [], Change.CLEARED: []}
    for one in frames:
        for result in pipeline.process(one, one.received_s):
            if result.transition is not None:
                changes[result.transition.change].append(one.seq)
    made = record_frames(Setup("site.yaml", config, prior()), iter(frames), Path("clip.mp4"))
    found = spans(made.times, made.alarming, config.rois[0].alarm)
    assert len(found) == 2
    assert found == list(zip(changes[Change.RAISED], changes[Change.CLEARED], strict=True))
    assert (made.length, made.width, made.height, made.times[-1]) == (90, WIDTH, HEIGHT, pytest.approx(8.9))
    assert made.intervals.sum() == pytest.approx(9.0)
    centre = made.boxes[made.owner == 25][0] @ [[1, 0], [0, 1], [0.5, 0], [0, 0.5]]
    assert centre == pytest.approx([48, 32], abs=5)


def test_a_calibrated_camera_is_judged_by_size() -> None:
    """An object of 0.9 m raises the alarm where the limit lies below it, and none where it lies far above."""
    corners = np.array([(-1200.0, 500.0), (1200.0, 500.0), (1200.0, 5500.0), (-1200.0, 5500.0)])
    scale = HEIGHT / FeedSpec().height  # the simulated camera, in a smaller and wider picture
    margin = ((WIDTH - scale * FeedSpec().width) / 2, 0.0)

    def relative(points_mm: Any) -> list[list[float]]:
        points = Geometry.of(FeedSpec()).to_px(np.array(points_mm)) * scale + margin
        return (points / (WIDTH, HEIGHT)).tolist()

    belt = {
        "points": relative(corners),
        "points_mm": corners.tolist(),
        "lip": relative([(-900.0, 6000.0), (900.0, 6000.0)]),
    }
    highest = []
    for limit_mm in (600.0, 1400.0):
        tree = site_tree()
        tree["cameras"][0]["rois"][0]["calibration"] = {**belt, "limit_mm": limit_mm}
        config = Setup("site.yaml", site(tree).cameras[0], prior())
        frames = (frame(k, bright=k > 5) for k in range(25))
        made = record_frames(config, frames, Path("clip.mp4"))
        highest.append(made.alarming.max())
    assert highest[0] > 0.9
    assert highest[1] < 0.5


def test_a_video_of_which_nothing_could_be_judged() -> None:
    with pytest.raises(LumpwatchError, match=r"clip\.mp4: .*filter"):
        record_frames(setup(), iter(()), Path("clip.mp4"))


def test_what_goes_wrong_in_a_task_names_the_video(tmp_path: Path) -> None:
    (tmp_path / "bad.mp4").write_bytes(b"nonsense" * 100)
    with pytest.raises(LumpwatchError, match=r"bad\.mp4: damaged, or not a video"):
        record_video(Watch(setup(), tmp_path / "bad.mp4"))


def test_a_recording_is_kept_as_it_is(tmp_path: Path) -> None:
    made = record_frames(setup(), (frame(k, bright=k > 5) for k in range(25)), Path("clip.mp4"))
    assert encode_recording(decode_recording(encode_recording(made))) == encode_recording(made)
    again = decode_recording(encode_recording(made))
    assert (again.width, again.height, again.length, again.prior) == (WIDTH, HEIGHT, 25, 1)
    assert (again.boxes == made.boxes).all()
    assert len(again.boxes)


def task_of(setup: Setup, video: Path) -> Task[Watch]:
    (task,) = tasks_of((setup,), (video,))
    return task


def test_what_a_result_depends_on_changes_its_key(folder: Path, tmp_path: Path) -> None:
    video = Path(shutil.copy(folder / "quiet.mp4", tmp_path))
    base = task_of(setup(), video).key
    assert base
    assert task_of(setup("other name"), video).key == base
    others = {
        task_of(setup(seed=2), video).key,
        task_of(Setup("site.yaml", camera(), None), video).key,
        task_of(Setup("site.yaml", camera(), prior(version=2)), video).key,
        task_of(setup(), folder / "lump.mp4").key,
    }
    os.utime(video, ns=(1, 1))
    others.add(task_of(setup(), video).key)
    assert len(others | {base}) == 6
    assert task_of(setup(), tmp_path / "gone.mp4").key == ""


# Whole backtests


def test_configurations_side_by_side(folder: Path, tmp_path: Path) -> None:
    counted: list[int] = []
    found = run(
        folder, setup("good"), setup("slow", seed=3, particles=60), told=lambda now: counted.append(now.done)
    )
    assert counted == [1, 2, 3, 4]
    assert found.failures == ()
    assert found.hours == pytest.approx(8.0 / 3600)
    for result in found.results:
        assert result.refused == 0
        assert [one.clip for one in result.judged] == ["lump.mp4", "quiet.mp4"]
    point = found.results[0].configured
    assert (point.raise_above, point.lumps, point.announced, point.false_alarms) == (0.9, 1, 1, 0)
    # The lump is there from 0.5 s to 2.9 s and falls at 2.4 s; the alarm waits for 0.2 s.
    assert 1.0 <= (point.warning_median_s or 0.0) <= 1.7
    assert point.quiet_h == pytest.approx((4.0 + 4.0 - 3.5) / 3600)
    write_backtest(found, tmp_path)
    kept = json.loads((tmp_path / "backtest.json").read_text())
    assert kept == as_record(found)
    assert [one["config"] for one in kept["results"]] == ["good", "slow"]
    rows = list(csv.DictReader((tmp_path / "lumps.csv").open()))
    assert [(row["config"], row["clip"], row["lip_frame"]) for row in rows] == [
        ("good", "lump.mp4", "25"),
        ("slow", "lump.mp4", "25"),
    ]


def test_the_same_in_any_number_of_threads(folder: Path) -> None:
    setups = (setup("one"), setup("two", seed=3))
    assert as_record(run(folder, *setups)) == as_record(run(folder, *setups, workers=3))


def test_the_hardest_clips_come_first(folder: Path) -> None:
    """A third clip shows a lump that the labels do not know, a fourth has labels of a lump that is not there."""
    base = clips(folder)
    unknown = Clip("unknown", folder / "lump.mp4", None, ())
    nothing = Clip("nothing", folder / "quiet.mp4", base[0].labels, base[0].boxes)
    terms = Terms(false_alarms_per_hour=1e6)  # so that the details are at the lowest threshold
    with ThreadPoolExecutor(1) as threads:
        found = run_backtest([setup()], [*base, unknown, nothing], terms, "fall", threads)
    (result,) = as_record(found)["results"]
    assert [clip["clip"] for clip in result["clips"]] == ["nothing", "unknown", "lump.mp4", "quiet.mp4"]
    point = found.results[0].configured
    assert (point.lumps, point.announced, point.true_alarms, point.false_alarms) == (2, 1, 1, 1)


def test_a_video_that_fails_is_left_out_of_all(folder: Path) -> None:
    lump, quiet = clips(folder)
    reaches = Clip(
        "reaches", quiet.video, lump.labels, (*lump.boxes, lump.boxes[-1].__class__(41, 1, 0, 0, 5, 5, None))
    )
    gone = Clip("gone", folder / "gone.mp4", None, ())
    with ThreadPoolExecutor(1) as threads:
        found = run_backtest([setup("a"), setup("b")], [reaches, lump, gone], Terms(), "fall", threads)
        assert [[one.clip for one in result.judged] for result in found.results] == [["lump.mp4"]] * 2
        labels, video = found.failures
        assert "labels frame 41, but reaches has 40 frames" in labels
        assert "gone.mp4: no such file" in video
        with pytest.raises(LumpwatchError, match=r"no video .*gone\.mp4"):
            run_backtest([setup()], [gone], Terms(), "fall", threads)


def test_a_prior_that_does_not_fit_is_told(folder: Path) -> None:
    wrong = Setup("wrong", camera(likelihood={"kind": "lump"}), prior(version=1))
    (result,) = run(folder, wrong).results
    assert result.refused == 2
    assert {one.recording.prior for one in result.judged} == {0}


def test_results_that_cannot_be_written(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(LumpwatchError, match="out: cannot be written"):
        write_backtest(run(folder), tmp_path / "out")


# The command


@pytest.mark.slow
def test_the_command_gives_the_same_bytes_whatever_the_number_of_workers(
    folder: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    videos = (folder / "lump.mp4", folder / "quiet.mp4")
    written = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        arguments = (folder / "site.yaml", "--videos", *videos, "--workers", workers, "--out", out)
        assert main(["backtest", *map(str, arguments)]) == 0
        written.append([(out / name).read_bytes() for name in ("backtest.json", "lumps.csv")])
    assert written[0] == written[1]
    told, _ = capsys.readouterr()
    assert "site.yaml: cam/apron, prior version 1" in told
    assert "1/1 (3-100 %)" in told
    assert "Recommended for at most 0.1 false alarms an hour: raise_above" in told
    assert "0.1 takes 30 hours without any" in " ".join(told.split())
    assert cv2.imread(str(tmp_path / "2" / "backtest.png")) is not None


@pytest.mark.slow
def test_the_command_agrees_with_replay_on_a_simulated_feed(tmp_path: Path, capsys: Captured) -> None:
    config = tmp_path / "demo.yaml"  # the clip gets a site.yaml of its own beside it
    config.write_text(demo_config(Path("var"), SEED))
    with as_file(files("lumpwatch.service.simulator") / "demo.prior") as path:
        PriorStore(load_config(config).store.path).save(read_file(path))
    spec = FeedSpec.from_query(FEED, seed=SEED)
    feed = write_video(spec, 15.0, tmp_path)
    replay = ("replay", config, feed.video, "--camera", CAMERA, "--out", tmp_path / "replay")
    assert main([str(argument) for argument in replay]) == 0
    expected = announcements(read_states(tmp_path / "replay" / "states.jsonl"), feed.labels, spec.fps)
    assert expected
    capsys.readouterr()
    arguments = ("--videos", feed.video, "--roi", ROI, "--out", tmp_path / "out", "--workers", 1, "--json")
    assert main(["backtest", *map(str, (config, *arguments))]) == 0
    written = (tmp_path / "out" / "backtest.json").read_text()
    assert capsys.readouterr().out == written
    (result,) = json.loads(written)["results"]
    assert result["configured"]["announced"] == sum((one.warned_s or 0.0) >= 1.0 for one in expected)
    median = np.median([one.warned_s or 0.0 for one in expected])
    assert result["configured"]["warning_median_s"] == pytest.approx(median, abs=1e-3)
    assert result["configured"]["false_alarms"] == 0


@pytest.mark.slow
def test_an_interrupted_run_goes_on_and_shares_meet(folder: Path, tmp_path: Path, capsys: Captured) -> None:
    """One share of two, then all: one task is left, and the bytes are those of a run that kept nothing."""
    (tmp_path / "bad.mp4").write_bytes(b"nonsense" * 100)
    (tmp_path / "bad.txt").write_text("")
    videos = [folder / "lump.mp4", folder / "quiet.mp4", tmp_path / "bad.mp4"]
    with_bad = ["backtest", str(folder / "site.yaml"), "--workers", "1", "--videos", *map(str, videos)]
    kept = ["--resume", str(tmp_path / "kept")]
    assert main([*with_bad, *kept, "--share", "0/2"]) == 1
    out, err = capsys.readouterr()
    assert out == "share 0 of 2: 1 of 2 finished\n"
    assert err.startswith("lumpwatch: failed: ")
    assert "bad.mp4: damaged" in err
    (first,) = (tmp_path / "kept").iterdir()
    before = first.stat().st_mtime_ns
    assert main([*with_bad, *kept, "--out", str(tmp_path / "resumed")]) == 1
    assert "left out" in capsys.readouterr().err
    assert len(list((tmp_path / "kept").iterdir())) == 2
    assert first.stat().st_mtime_ns == before
    config = Setup("site.yaml", load_config(folder / "site.yaml").cameras[0], prior(version=1))
    with ThreadPoolExecutor(1) as threads:
        write_backtest(run_backtest([config], archive(videos), Terms(), "fall", threads), tmp_path / "plain")
    for name in ("backtest.json", "lumps.csv"):
        assert (tmp_path / "resumed" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
    store = finished_recordings(tmp_path / "kept")
    assert store.load(first.stem) is not None
    first.write_bytes(first.read_bytes()[:-1])  # a disk that was full
    assert store.load(first.stem) is None


@pytest.mark.slow
def test_a_damaged_video_leaves_the_rest(folder: Path, tmp_path: Path, capsys: Captured) -> None:
    content = (folder / "quiet.mp4").read_bytes()
    shutil.copy(folder / "lump.mp4", tmp_path)
    shutil.copy(folder / "lump.txt", tmp_path)
    labels = tmp_path / "beyond.txt"
    (tmp_path / "beyond.mp4").write_bytes(content)
    labels.write_text("999,1,0,0,5,5\n")
    videos = (tmp_path / "lump.mp4", tmp_path / "beyond.mp4")
    assert main(["backtest", str(folder / "site.yaml"), "--videos", *map(str, videos)]) == 1
    out, err = capsys.readouterr()
    assert "1/1 (" in out
    assert err == f"lumpwatch: left out: {labels}: labels frame 999, but beyond.mp4 has 40 frames\n"


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("--least-warning-s", "-1"), "--least-warning -1s: "),
        (("--tolerance-s", "nan"), "--tolerance nans: must be finite"),
        (("--false-alarms-per-hour", "0"), "--false-alarms-per-hour 0: "),
        (("--workers", "0"), "--workers 0: "),
        (("--share", "2/2", "--resume", "kept"), "--share '2/2': expected INDEX/COUNT"),
        (("--share", "0/2"), "--share needs --resume"),
        (("--worker-mb", "5"), "--worker-mb 5: expected 512 to"),
        (("--camera", "c2"), "site.yaml: --camera c2: "),
        (("--roi", "r2"), "site.yaml: --roi r2: camera cam "),
        (("--labels", "a.txt", "b.txt"), "found 2 for 1 videos"),
    ],
)
def test_bad_arguments_are_one_line(
    folder: Path, capsys: Captured, more: tuple[str, ...], reason: str
) -> None:
    told = failed(capsys, folder / "site.yaml", "--videos", folder / "lump.mp4", *more, code=2)
    assert reason in told


def test_configurations_that_cannot_be_used(folder: Path, tmp_path: Path, capsys: Captured) -> None:
    config, videos = folder / "site.yaml", ("--videos", folder / "lump.mp4")
    assert "site.yaml is given more than once" in failed(capsys, config, config, *videos, code=2)
    untrained = tmp_path / "untrained.yaml"
    untrained.write_text(config.read_text())
    told = failed(capsys, config, untrained, *videos, code=2)
    assert told.startswith(
        f"lumpwatch: {untrained}: camera cam, roi apron: likelihood kind histogram needs a"
    )
    tree = site_tree()
    tree["cameras"].append({**tree["cameras"][0], "id": "cam2"})
    untrained.write_text(json.dumps(tree))
    told = failed(capsys, untrained, *videos, code=2)
    assert "--camera is needed to choose one of cam, cam2" in told
    roi = {**tree["cameras"][0]["rois"][0], "id": "chute"}
    tree["cameras"] = [{**tree["cameras"][0], "rois": [roi, {**roi, "id": "apron"}]}]
    untrained.write_text(json.dumps(tree))
    assert "--roi is needed to choose one of chute, apron" in failed(capsys, untrained, *videos, code=2)


def test_files_that_cannot_be_used(folder: Path, tmp_path: Path, capsys: Captured) -> None:
    config = folder / "site.yaml"
    missing = failed(capsys, config, "--videos", tmp_path / "a.mp4", "--unlabelled-is-empty", code=1)
    assert "a.mp4: no such file or folder" in missing
    (tmp_path / "file").write_text("")
    arguments = ("--videos", folder / "lump.mp4", "--out", tmp_path / "file" / "out")
    assert "out: cannot be written" in failed(capsys, config, *arguments, code=1)


def test_a_recording_of_one_frame_has_no_length() -> None:
    one = record_frames(setup(), iter([frame(0)]), Path("clip.mp4"))
    assert isinstance(one, Recording)
    assert one.intervals.tolist() == [0.0]
