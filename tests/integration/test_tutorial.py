"""The commands of docs/tutorial.md, as they stand there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"
BLOCKS = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
QUOTED = re.findall(r"```text\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)


def test_there_are_ten_commands() -> None:
    commands = [line for block in BLOCKS for line in block.splitlines() if line.startswith("lumpwatch ")]
    assert len(commands) == 11  # the daemon and who listens to it are the tenth


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_tutorial_leads_to_an_alarm(tmp_path: Path) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    # `set -m`: jobs of their own, so that `kill %1` is known.
    script = "set -em\n" + "\n".join(BLOCKS)
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True,
        timeout=580, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "raised" in done.stdout
    said = " ".join(done.stdout.split())  # tables break lines where a terminal would end
    for line in "".join(QUOTED).splitlines():
        assert line in said, f"not said as the page has it: {line}\n{done.stdout}"
    assert "its line broke" not in done.stderr  # Ctrl-C and kill %1 reach the workers as well
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["rois"]["apron"]["alarms"]["raised"] >= 1
    for name in ("grid.png", "out/alarms.jsonl", "var/priors/cam/apron/000001.html", "backtest"):
        assert (tmp_path / name).exists(), name
