"""The help as a whole: every command, in groups, at once; and the nearest match of a command that there is not."""

from __future__ import annotations

import subprocess
import sys

from lumpwatch.service.cli import _MODULES
from lumpwatch.service.cli.overview import GROUPS
from tests.cli.test_cli import Captured, done, failed


def test_the_overview_has_every_command_once() -> None:
    listed = [name for group in GROUPS.values() for name in group]
    assert sorted(listed) == sorted(name for names in _MODULES.values() for name in names)


def test_the_help_imports_no_command(capsys: Captured) -> None:
    told = done(capsys, "--help")
    assert all(f"{title}:" in told for title in GROUPS)
    code = "import sys; from lumpwatch.service.cli import main; main(['--help']); print([m for m in "
    code += "('numpy', 'rich', 'pydantic', 'zenoh', 'cv2') if m in sys.modules])"
    done_ = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done_.stdout.splitlines()[-1] == "[]"


def test_a_command_that_there_is_not_gets_the_nearest_one(capsys: Captured) -> None:
    assert "did you mean replay?" in failed(capsys, "reply", code=2)
    assert "did you mean" not in failed(capsys, "qqq", code=2)
