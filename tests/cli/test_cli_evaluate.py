"""`lumpwatch evaluate`: both formats of a result, the table, the JSON, one line for each failure."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import pytest

from lumpwatch.models.evaluation import METRICS, Scores
from lumpwatch.service.cli import main
from lumpwatch.service.core.decision import Decision
from lumpwatch.service.protocol.messages import ObjectRecord, StateLine

Captured = pytest.CaptureFixture[str]

# Object 1 stands for four frames, object 2 for one; conf 0 is to be ignored.
TRUTH = "1,1,0,0,10,10,1\n2,1,0,0,10,10,1\n3,1,0,0,10,10,1\n4,1,0,0,10,10\n4,2,100,0,10,10\n2,9,50,50,5,5,0\n"
# Found in frames 2 to 4, shifted by 5 in frame 4 (overlap 1/3); conf -1 is a box like others.
RESULT = "2,7,0,0,10,10,-1,-1,-1\n3,7,0,0,10,10,-1,-1,-1\n4,7,5,0,10,10,-1,-1,-1\n3,8,0,0,9,9,0,-1,-1\n"


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return write(tmp_path / "gt.txt", TRUTH)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def states(path: Path, *rois: tuple[str, str]) -> Path:
    """The boxes of RESULT as a replay writes them; the ROIs after the first have none."""
    boxes = {2: 0.0, 3: 0.0, 4: 5.0}
    lines = []
    for frame in range(1, 6):
        for number, (camera, roi) in enumerate(rois):
            found = ObjectRecord(
                x=boxes.get(frame, 0.0),
                y=0,
                w=10,
                h=10,
                existence=0.9,
                model="belt",
                id=7,
                spread_x=1,
                spread_y=1,
            )
            there = number == 0 and frame in boxes
            line = StateLine(
                frame=frame,
                time_s=0.1 * frame,
                camera=camera,
                roi=roi,
                state=Decision.LUMP if there else Decision.CLEAR,
                existence=0.9 if there else 0.1,
                objects=(found,) if there else (),
            )
            lines.append(line.line().decode())
    return write(path, "\n".join(lines) + "\n")


def scores(capsys: Captured, *arguments: object) -> dict[str, float | None]:
    """What `lumpwatch evaluate … --json` prints."""
    assert main(["evaluate", *map(str, arguments), "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out)


def failed(capsys: Captured, *arguments: object, code: int) -> str:
    """The only line on standard error of a call that fails with this code."""
    assert main(["evaluate", *map(str, arguments)]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("lumpwatch")
    assert len(err.splitlines()) == 1
    return err


def assert_the_scores(found: dict[str, float | None]) -> None:
    """Frames 1 to 4 hold 5 true boxes and 3 of the result; overlaps 1, 1, 1/3; at 0.5 two pairs, three misses,
    one false positive. SFDA (0 + 1 + 1 + (1/3) / 1.5) / 4; ATA ((2 + 1/3) / 4) / ((2 + 1) / 2).
    """
    assert found["sfda"] == pytest.approx((2 + 2 / 9) / 4)
    assert found["ata"] == pytest.approx(((7 / 3) / 4) / 1.5)
    assert found["mota"] == pytest.approx(1 - 4 / 5)
    assert (found["matches"], found["misses"], found["false_positives"]) == (2, 3, 1)
    assert (found["truth_boxes"], found["result_boxes"], found["frames"]) == (5, 3, 4)


def test_motchallenge_text(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    found = scores(capsys, write(tmp_path / "result.txt", RESULT), truth)
    assert_the_scores(found)
    assert set(found) == {field.name for field in fields(Scores)}


def test_states_of_a_replay(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    """Known by what is in the file, not by its name."""
    assert_the_scores(scores(capsys, states(tmp_path / "states.jsonl", ("cam", "apron")), truth))
    assert_the_scores(scores(capsys, states(tmp_path / "renamed", ("cam", "apron")), truth))


@pytest.mark.parametrize(
    "options", [("--roi", "apron", "--camera", "cam"), ("--roi", "apron"), ("--camera", "cam")]
)
def test_one_roi_of_several(capsys: Captured, tmp_path: Path, truth: Path, options: tuple[str, ...]) -> None:
    path = states(tmp_path / "states.jsonl", ("cam", "apron"), ("other", "chute"))
    assert_the_scores(scores(capsys, path, truth, *options))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ((), "without --camera and --roi: fits more than one"),
        (("--camera", "cam"), "--camera cam: fits more than one"),
        (("--roi", "lip"), "--roi lip: fits none"),
        (("--camera", "other", "--roi", "chute"), "--camera other --roi chute: fits none"),
    ],
)
def test_no_single_roi(
    capsys: Captured, tmp_path: Path, truth: Path, options: tuple[str, ...], reason: str
) -> None:
    path = states(tmp_path / "states.jsonl", ("cam", "apron"), ("cam", "chute"))
    told = failed(capsys, path, truth, *options, code=2)
    assert reason in told
    assert f"{path} (cam/apron, cam/chute)" in told


def test_the_threshold(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    found = scores(capsys, write(tmp_path / "result.txt", RESULT), truth, "--threshold", "0.3")
    assert (found["matches"], found["threshold"]) == (3, 0.3)


@pytest.mark.parametrize("text", ["", "\n \n"])
def test_a_result_without_boxes(capsys: Captured, tmp_path: Path, truth: Path, text: str) -> None:
    """An undefined score is null."""
    found = scores(capsys, write(tmp_path / "result.txt", text), truth)
    assert (found["sfda"], found["ata"], found["recall"], found["misses"]) == (0, 0, 0, 5)
    assert found["motp"] is found["precision"] is None


def test_states_without_objects(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    path = states(tmp_path / "states.jsonl", ("cam", "chute"), ("cam", "apron"))
    found = scores(capsys, path, truth, "--roi", "apron")
    assert (found["result_boxes"], found["misses"]) == (0, 5)


def test_the_table(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    """One line a metric, within 80 columns."""
    assert main(["evaluate", str(write(tmp_path / "result.txt", RESULT)), str(truth)]) == 0
    out = capsys.readouterr().out
    lines = out.splitlines()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if line.startswith("│")]
    assert [[name, *rest] for name, _, *rest in rows] == [[m.name, m.better, m.says] for m in METRICS]
    values = {name: value for name, value, *_ in rows}
    assert (values["SFDA"], values["misses"]) == ("0.556", "3")
    assert "result.txt against gt.txt" in out
    assert lines[-1] == "boxes: 5 true, 3 found; tracks: 2 true, 1 found; frames: 4; threshold: 0.5"


def test_undefined_in_the_table(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    assert main(["evaluate", str(write(tmp_path / "result.txt", "")), str(truth)]) == 0
    out = capsys.readouterr().out
    assert sum("undefined" in line for line in out.splitlines()) == 2


def test_help_has_an_example(capsys: Captured) -> None:
    assert main(["evaluate", "--help"]) == 0
    told = capsys.readouterr().out
    assert "usage: lumpwatch evaluate" in told
    assert told.partition("example:\n")[2].strip().startswith("lumpwatch evaluate ")


@pytest.mark.parametrize("options", [("--threshold", "half"), ("--jsno",), ("a", "b", "c")])
def test_bad_arguments(capsys: Captured, truth: Path, options: tuple[str, ...]) -> None:
    assert "--help" in failed(capsys, truth, truth, *options, code=2)


@pytest.mark.parametrize("threshold", ["-0.1", "1.5", "nan"])
def test_bad_thresholds(capsys: Captured, truth: Path, threshold: str) -> None:
    told = failed(capsys, truth, truth, f"--threshold={threshold}", code=2)
    assert f"--threshold {threshold}: " in told


@pytest.mark.parametrize("option", ["--camera", "--roi"])
def test_text_has_no_rois(capsys: Captured, truth: Path, option: str) -> None:
    assert f"{option} x: {truth} is not a states.jsonl" in failed(capsys, truth, truth, option, "x", code=2)


def test_missing_files(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    missing = tmp_path / "none.txt"
    reason = f"{missing}: cannot be read"
    assert reason in failed(capsys, missing, truth, code=1)
    assert reason in failed(capsys, truth, missing, code=1)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1,1,2,3,4\n", "line 1: expected frame,id,x,y,w,h"),
        ("1,1,0,0,5,5\n1,1,0,0,6,6\n", "line 2: track 1 "),
        ("1,1,1e20,0,5,5\n", "a number is beyond"),
        ('{"frame": 1}\n', "line 1: "),
        ("{\n", "line 1: "),
    ],
)
def test_bad_results(capsys: Captured, tmp_path: Path, truth: Path, text: str, reason: str) -> None:
    path = write(tmp_path / "result.txt", text)
    told = failed(capsys, path, truth, code=1)
    assert str(path) in told
    assert reason in told


def test_a_track_twice_in_a_frame_of_a_replay(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    path = states(tmp_path / "states.jsonl", ("cam", "apron"))
    write(path, 2 * path.read_text(encoding="utf-8"))
    assert f"{path}: track 7 " in failed(capsys, path, truth, code=1)


def test_a_result_that_is_not_text(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"\xff\xfe\x00\x80")
    assert f"{path}: is not text" in failed(capsys, path, truth, code=1)


def test_a_truth_without_boxes(capsys: Captured, tmp_path: Path, truth: Path) -> None:
    assert "holds no labelled box" in failed(capsys, truth, write(tmp_path / "empty.txt", ""), code=1)


def test_what_lies_on_an_ignored_box_counts_neither_way(tmp_path: Path, capsys: Captured) -> None:
    """A box on something that is hardly visible is neither a hit nor a false one; one on nothing is false."""
    truth = write(tmp_path / "gt.txt", "1,1,0,0,10,10,1\n1,2,50,0,10,10,0\n1,3,58,0,9,10,0\n")
    result = write(tmp_path / "found.txt", "1,7,0,0,10,10\n1,8,51,0,10,10\n1,9,100,0,10,10\n")
    found = scores(capsys, result, truth)
    assert found["false_positives"] == 1
    assert found["precision"] == 0.5


def test_only_counted_objects_on_request(truth: Path, tmp_path: Path, capsys: Captured) -> None:
    path = states(tmp_path / "states.jsonl", ("cam", "apron"))
    path.write_text(path.read_text().replace('"counts":true', '"counts":false', 1))
    assert scores(capsys, path, truth)["result_boxes"] == 3
    assert scores(capsys, path, truth, "--counted")["result_boxes"] == 2
