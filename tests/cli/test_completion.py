"""`lumpwatch completion`: what the parser takes is offered; in bash by bash itself, in other shells where they are."""

from __future__ import annotations

import argparse
import contextlib
import io
import shutil
import subprocess
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.completion import grammars
from lumpwatch.service.cli.grammar import Grammar, grammar_of
from lumpwatch.service.cli.overview import GROUPS
from lumpwatch.service.cli.shells import SHELLS
from tests.cli.test_cli import Captured, failed

ASK = """
source {script}
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_lumpwatch 2>/dev/null
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def commands() -> list[Grammar]:
    return grammars()


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The script for bash, as the command prints it."""
    path = tmp_path_factory.mktemp("completion") / "lumpwatch.bash"
    with contextlib.redirect_stdout(io.StringIO()) as told:
        assert main(["completion", "bash"]) == 0
    path.write_text(told.getvalue())
    return path


def offered(script: Path, *words: str) -> list[str]:
    """What bash offers for the last of the words."""
    run = ["bash", "-c", ASK.format(script=script), "ask", "lumpwatch", *words]
    done = subprocess.run(run, capture_output=True, text=True, timeout=30, cwd=script.parent, check=True)
    assert done.stderr == ""
    return done.stdout.split("\n")[:-1]


def test_bash_offers_commands(script: Path) -> None:
    assert sorted(offered(script, "re")) == ["record", "reference", "refine", "replay", "report", "reset"]
    assert {name for group in GROUPS.values() for name in group} <= set(offered(script, ""))


def test_bash_offers_options_choices_and_files(script: Path) -> None:
    (script.parent / "my site.yaml").touch()
    assert offered(script, "replay", "--pl") == ["--plot"]
    assert offered(script, "events", "site.yaml", "--format", "") == ["table", "jsonl", "csv"]
    assert offered(script, "priors", "ro") == ["rollback"]
    assert offered(script, "check", "my") == ["my site.yaml"]
    assert offered(script, "replay", "--out", "my") == ["my site.yaml"]
    assert offered(script, "replay", "--camera", "my") == [""]  # a name is no file
    assert offered(script, "ack", "--act") == [""]  # the older form of --by


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_and_option_is_in_the_script(shell: str, commands: list[Grammar]) -> None:
    assert [one.name for one in commands] == [name for group in GROUPS.values() for name in group]
    text = SHELLS[shell](commands)
    for command in commands:
        of_it = [
            line for line in text.splitlines() if f"{command.name})" in line or f" {command.name}'" in line
        ]
        for option in command.options:
            for name in option.names:
                assert any((name if shell != "fish" else name.lstrip("-")) in line for line in of_it)


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_takes_the_script(shell: str, commands: list[Grammar]) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    done = subprocess.run(
        [shell, "-n"], input=SHELLS[shell](commands), capture_output=True, text=True, timeout=30
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_signs_of_the_shells_are_quoted() -> None:
    parser = argparse.ArgumentParser(description="It's one. And more")
    parser.add_argument("--at", metavar="X:Y", help="the point's [x:y]")
    parser.add_argument("--old", help=argparse.SUPPRESS)
    grammar = grammar_of("ack", parser)
    assert grammar.help == "It's one"
    assert "--old" not in SHELLS["bash"]([grammar])
    assert r"-d 'the point\'s [x:y]'" in SHELLS["fish"]([grammar])
    assert r"s \[x\:y\]]:X\:Y: " in SHELLS["zsh"]([grammar])


def test_another_shell_is_refused(capsys: Captured) -> None:
    assert "invalid choice: 'csh'" in failed(capsys, "completion", "csh", code=2)
