"""One grammar: `lumpwatch COMMAND [VERB] CONFIG …`; the order of 0.1, with the file first, works with a warning."""

from __future__ import annotations

from pathlib import Path

import pytest

from lumpwatch.service.cli import _MODULES, main, of_command, parser
from lumpwatch.service.cli.word_order import verb_first
from tests.cli.test_cli import Captured, failed
from tests.service_helpers import site_tree

COMMANDS = [name for names in _MODULES.values() for name in names]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_verb_stands_before_all_other_words(name: str) -> None:
    places = [bool(a.choices) for a in of_command(parser(name), name)._actions if not a.option_strings]
    assert places == sorted(places, reverse=True)


@pytest.mark.parametrize("name", COMMANDS)
def test_whoever_acts_is_given_by_one_option(name: str) -> None:
    shown = of_command(parser(name), name).format_help()
    assert "--actor" not in shown


@pytest.mark.parametrize(
    ("command", "given", "meant"),
    [
        ("users", "a.yaml add anna --role viewer", "add a.yaml anna --role viewer"),
        ("users", "--role viewer a.yaml add anna", "--role viewer add a.yaml anna"),
        ("users", "add a.yaml list", "add a.yaml list"),
        ("evidence", "a.yaml fetch 1 --out show", "fetch a.yaml 1 --out show"),
        ("evidence", "--out=x a.yaml fetch 1", "--out=x fetch a.yaml 1"),
        ("evidence", "--bus a.yaml list", "--bus list a.yaml"),
        ("service", "--by in a.yaml out --reason x", "--by in out a.yaml --reason x"),
        ("service", "-- a.yaml out", "-- out a.yaml"),
        ("service", "a.yaml off", "a.yaml off"),
        ("service", "out", "out"),
        ("service", "", ""),
    ],
)
def test_the_file_before_the_verb(command: str, given: str, meant: str) -> None:
    assert verb_first(of_command(parser(command), command), given.split()) == meant.split()


def test_both_orders_do_the_same_and_the_older_warns(capsys: Captured, tmp_path: Path) -> None:
    config = tmp_path / "site.yaml"
    config.write_text(str(site_tree()), encoding="utf-8")
    said = []
    for words in (("list", config), (config, "list")):
        assert main(["evidence", *map(str, words)]) == 0
        said.append(capsys.readouterr())
    (new, quiet), (old, warned) = said
    assert (old, quiet) == (new, "")
    assert "lumpwatch evidence list: write the verb before the file" in warned
    assert "invalid choice" in failed(capsys, "evidence", config, "lst", code=2)
