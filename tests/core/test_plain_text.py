"""What comes from outside stays one line of bounded length, and commands no terminal."""

from __future__ import annotations

import io
import logging
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.core.logs import log_to_stderr
from lumpwatch.service.core.plain_text import LONGEST, printable, printable_lines

ESC = "\x1b[2J\x1b]0;owned\x07"


@given(st.text(max_size=200))
def test_what_is_printed_is_one_line_without_control_characters(text: str) -> None:
    shown = printable(text)
    assert shown.splitlines() in ([shown], [])
    assert not any(ord(c) < 32 or 0x7F <= ord(c) < 0xA0 for c in shown)
    shown.encode()  # half a surrogate pair would end whoever writes it


def test_ordinary_text_stays_as_it_is() -> None:
    assert printable("Förderband [2] läuft /\\ 漢字") == "Förderband [2] läuft /\\ 漢字"
    assert printable("a\nb\r\x9bc\u202e") == "a\\nb\\r\\x9bc\\u202e"


def test_ten_megabytes_are_cut() -> None:
    shown = printable("x" * 10_000_000)
    assert len(shown) < LONGEST + 50
    assert shown.endswith("(9996000 more characters)")
    assert len(printable_lines("x\n" * 1_000_000).splitlines()) == 201


def test_a_log_holds_no_lines_that_were_not_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    before = logging.getLogger().handlers[:]
    out = io.StringIO()
    monkeypatch.setattr(sys, "stderr", out)
    try:
        log_to_stderr()
        logging.getLogger("x").warning("note: %s", f"fine\n2026-01-01T00:00:00 ERROR forged{ESC}")
        error = ValueError(f"first\nsecond {ESC}" + "y" * 10_000_000)
        logging.getLogger("x").error("failed", exc_info=error)
    finally:
        logging.basicConfig(handlers=before, force=True)
    lines = out.getvalue().splitlines()
    assert "forged" in lines[0]
    assert "\x1b" not in out.getvalue()
    assert len(out.getvalue()) < 20_000
    assert any("ValueError: first" in line for line in lines)
