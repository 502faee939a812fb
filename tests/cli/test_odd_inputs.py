"""What people really give to commands: refused in one line that names it, and none takes the machine's memory."""

from __future__ import annotations

import io
import json
import os
import socket
import threading
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.alarms import read_answer
from lumpwatch.service.config import load_config
from lumpwatch.service.console.work.trials import Deeds
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.offline.html import html_text
from lumpwatch.service.protocol import ActReply
from lumpwatch.service.training.evidence_labels import track_labels
from tests.service_helpers import camera, site_tree

Captured = pytest.CaptureFixture[str]
STRAIGHT_THROUGH_THE_MIDDLE = ("960,40", "960,540", "960,1040")


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "site.yaml"
    path.write_text(json.dumps(site_tree()))
    return str(path)


def refused(capsys: Captured, *arguments: str) -> str:
    assert main(arguments) in (1, 2)
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    return told


@pytest.mark.parametrize(
    "size", ["²²x1080", "1920x²", "1920x1080x3", "x", "99999999999x9", "9" * 5000 + "x9", "8x8"]
)
def test_sizes_that_are_none(capsys: Captured, config: str, size: str) -> None:
    assert "is not a size such as 1920x1080" in refused(capsys, "lens", size, "--edge", "1,2", "3,4", "5,6")
    assert "is not a size such as 1920x1080" in refused(capsys, "check", config, "--size", size)


@pytest.mark.parametrize("edge", [("5,5", "5,5", "5,5"), STRAIGHT_THROUGH_THE_MIDDLE])
def test_edges_that_tell_nothing_find_no_lens(capsys: Captured, edge: tuple[str, ...]) -> None:
    assert "tell nothing" in refused(capsys, "lens", "1920x1080", "--edge", *edge)


def test_a_device_in_the_place_of_a_file(capsys: Captured, config: str, tmp_path: Path) -> None:
    assert "/dev/zero: larger than" in refused(capsys, "check", "/dev/zero")
    assert "/dev/zero: is larger than" in refused(
        capsys, "priors", "import", config, "/dev/zero", "--camera", "cam", "--roi", "apron"
    )


def test_numbers_too_large_in_a_result(capsys: Captured, tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("1,1,0,0,9,9\n")
    (tmp_path / "huge.txt").write_text("1e300,1,0,0,9,9\n")
    assert "huge.txt, line 1" in refused(
        capsys, "evaluate", str(tmp_path / "huge.txt"), str(tmp_path / "gt.txt")
    )


@pytest.mark.parametrize(
    "answer", [b"", b"not http at all\r\n\r\n", b'HTTP/1.0 200 OK\r\n\r\n{"problems": 3}']
)
def test_another_program_on_the_port_of_health(
    capsys: Captured, config: str, tmp_path: Path, answer: bytes
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        tree = site_tree() | {"telemetry": {"listen": f"127.0.0.1:{server.getsockname()[1]}"}}
        Path(config).write_text(json.dumps(tree))
        asked = threading.Thread(target=lambda: answer_one(server, answer))
        asked.start()
        assert "http://127.0.0.1:" in refused(capsys, "health", config)
        asked.join()


def answer_one(server: socket.socket, answer: bytes) -> None:
    connection, _ = server.accept()
    with connection:
        connection.recv(4096)
        connection.sendall(answer)


@pytest.mark.parametrize("answer", [b"", b"{}", b"[" * 100_000, b"\xff", b"null"])
def test_an_answer_of_another_program_on_the_bus(answer: bytes) -> None:
    with pytest.raises(LumpwatchError, match="cam/apron: the answer is not one"):
        read_answer(ActReply, answer, "cam/apron")


def test_states_of_evidence_that_another_version_wrote() -> None:
    with pytest.raises(LumpwatchError, match="the states of evidence cannot be read"):
        track_labels(b'{"things": []}\n', camera())


def test_a_deed_that_a_power_cut_left_half_written(tmp_path: Path) -> None:
    deeds = Deeds(tmp_path / "deeds.jsonl")
    deeds.note("emma", "promoted", "cam", "apron")
    with (tmp_path / "deeds.jsonl").open("a") as file:
        file.write('{"time": "2026-')
    assert [deed["actor"] for deed in deeds.latest("cam", "apron")] == ["emma"]


def test_a_terminal_that_is_not_utf_8(monkeypatch: pytest.MonkeyPatch) -> None:
    printed = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(printed, encoding="ascii", write_through=True))
    assert main(["train", "--help"]) == 0
    assert b"frame,id,x,y,w,h,\\u2026" in printed.getvalue()


def test_a_clip_whose_name_is_not_utf_8() -> None:
    assert html_text(os.fsdecode(b"gr\xf6\xdfe <1>.mp4")) == "gr\\udcf6\\udcdfe &lt;1&gt;.mp4"


@pytest.mark.parametrize("what", ["train", "refine", "reference"])
def test_a_store_that_takes_nothing_is_named_before_the_work(
    capsys: Captured, config: str, tmp_path: Path, what: str
) -> None:
    """None of the films is there: nothing was read before the store was tried."""
    (tmp_path / "var").mkdir()
    for name in ("priors", "references"):
        (tmp_path / "var" / name).write_text("a file in the place of the folder")
    (tmp_path / "clip.txt").write_text("1,1,0,0,9,9\n")
    video = str(tmp_path / "clip.mp4")
    labels = [str(tmp_path / "clip.txt")] if what == "train" else []
    assert "cannot be written (Not a directory)" in refused(capsys, what, config, video, *labels)


def test_a_film_beside_its_configuration_is_found_from_anywhere(
    config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert load_config(Path(config)).cameras[0].source.path == Path("clip.mp4"), "nowhere yet"
    (tmp_path / "clip.mp4").touch()
    assert load_config(Path(config)).cameras[0].source.path == tmp_path / "clip.mp4"
    (elsewhere / "clip.mp4").touch()
    assert load_config(Path(config)).cameras[0].source.path == Path("clip.mp4")
