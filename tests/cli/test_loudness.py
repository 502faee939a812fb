"""`--quiet` and `--verbose`: progress and log on standard error; what is asked for stays on standard output."""

from __future__ import annotations

import io
import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.common import progress
from lumpwatch.service.core import LEVEL
from tests.cli.test_cli import Captured, failed


@pytest.fixture(autouse=True)
def _same_log(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Commands set up the log of the process; here it is as before afterwards."""
    monkeypatch.delenv(LEVEL, raising=False)
    monkeypatch.delenv("LUMPWATCH_PROGRESS", raising=False)
    ours, root = logging.getLogger("lumpwatch"), logging.getLogger()
    before = root.handlers[:], root.level, ours.level
    yield
    root.handlers[:], root.level = before[0], before[1]
    ours.setLevel(before[2])


def simulated(capsys: Captured, folder: Path, *more: str) -> tuple[str, str]:
    """What `simulate` prints on standard output and standard error."""
    assert main(["simulate", str(folder), "--seconds", "0.2", *more]) == 0
    assert LEVEL not in os.environ
    out, err = capsys.readouterr()
    return out.replace(str(folder), ""), err


def test_verbose_tells_the_stages_and_quiet_nothing(capsys: Captured, tmp_path: Path) -> None:
    plain = simulated(capsys, tmp_path / "a")
    assert plain[1] == ""
    out, err = simulated(capsys, tmp_path / "b", "--verbose")
    assert out == plain[0]
    begins, done = (line for line in err.splitlines() if "rendering" in line)
    assert "DEBUG" in begins
    assert begins.endswith("rendering: begins")
    assert "rendering: done after " in done
    assert simulated(capsys, tmp_path / "c", "-q") == plain


@pytest.mark.parametrize(("level", "bar"), [("info", True), ("warning", False), ("debug", False)])
def test_the_bar_belongs_to_the_level_info(monkeypatch: pytest.MonkeyPatch, level: str, bar: bool) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv(LEVEL, level)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", terminal := Terminal())
        with progress("rendering", 3) as advance:
            advance(3)
    assert ("rendering" in terminal.getvalue()) is bar


def test_the_level_ends_with_the_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(LEVEL, "error")
    assert main(["simulate", str(tmp_path / "a"), "--seconds", "-1", "--verbose"]) == 2
    assert os.environ[LEVEL] == "error"


def test_libraries_do_not_fill_the_log(capsys: Captured, tmp_path: Path) -> None:
    assert main(["simulate", str(tmp_path / "a"), "--seconds", "-1", "--verbose"]) == 2
    logging.getLogger("numba.core.ssa").debug("a page")
    logging.getLogger("lumpwatch.service.bus").debug("a line")
    err = capsys.readouterr().err
    assert "a line" in err
    assert "a page" not in err


def test_a_configuration_that_is_there_stays(capsys: Captured, tmp_path: Path) -> None:
    simulated(capsys, tmp_path)
    assert simulated(capsys, tmp_path)[1] == ""  # the same feed again
    (tmp_path / "site.yaml").write_text("site: mine\n")
    assert "site.yaml was there already and stays" in simulated(capsys, tmp_path)[1]
    assert (tmp_path / "site.yaml").read_text() == "site: mine\n"


def test_both_are_refused(capsys: Captured) -> None:
    assert "not allowed with" in failed(capsys, "run", "site.yaml", "--quiet", "--verbose", code=2)
