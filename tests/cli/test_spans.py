"""One grammar of spans: TIME with a unit on every command, the older options with seconds still understood."""

from __future__ import annotations

import argparse

import pytest

from lumpwatch.service.cli import parser


def parsed(*arguments: str) -> argparse.Namespace:
    return parser(arguments[0]).parse_args(arguments)


@pytest.mark.parametrize(
    ("arguments", "name", "seconds"),
    [
        (("simulate", "out", "--for", "1m30s"), "for_s", 90.0),
        (("simulate", "out", "--seconds", "90"), "for_s", 90.0),
        (("simulate", "out"), "for_s", 60.0),
        (("bench", "a.yaml", "--for", "20s"), "for_s", 20.0),
        (("demo", "--for", "60s"), "for_s", 60.0),
        (("demo", "--seconds", "0"), "for_s", 0.0),
        (("record", "a.yaml", "--out", "a.mp4", "--for", "2m"), "for_s", 120.0),
        (("backtest", "a.yaml", "--videos", "a.mp4"), "least_warning_s", 1.0),
        (("backtest", "a.yaml", "--videos", "a.mp4", "--least-warning", "1500ms"), "least_warning_s", 1.5),
        (("backtest", "a.yaml", "--videos", "a.mp4", "--tolerance-s", "2"), "tolerance_s", 2.0),
        (("health", "a.yaml", "--timeout", "500ms"), "timeout", 0.5),
        (("health", "a.yaml", "--timeout", "5"), "timeout", 5.0),
        (("deploy", "up", "a.yaml", "--timeout", "3m"), "timeout", 180.0),
    ],
)
def test_spans(arguments: tuple[str, ...], name: str, seconds: float) -> None:
    assert getattr(parsed(*arguments), name) == pytest.approx(seconds)


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "out", "--for", "60"),
        ("demo", "--for", "60"),
        ("record", "a.yaml", "--out", "a.mp4", "--for", "60"),
        ("backtest", "a.yaml", "--videos", "a.mp4", "--tolerance", "60"),
    ],
)
def test_a_number_alone_is_refused_and_the_unit_asked_for(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parsed(*arguments)
    assert "say the unit: 60s or 60m" in capsys.readouterr().err


def test_a_bare_timeout_still_counts_and_the_unit_is_asked_for(caplog: pytest.LogCaptureFixture) -> None:
    parsed("health", "a.yaml", "--timeout", "5")
    assert "say the unit, 5s" in caplog.text
    for wrong in ("0", "-1", "nan", "inf", "soon"):
        with pytest.raises(SystemExit):
            parsed("health", "a.yaml", "--timeout", wrong)
