"""The long run: its limits, and a minute of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults.long_run import FAULTS, Held, grown, run

HELD = Held(800.0, 190.0, 100.0, 6.0, 54.0, 1.0, 20.0)


def test_what_grows_is_named() -> None:
    assert grown([HELD] * 12) == []
    assert grown([replace(HELD, memory_mb=2000.0)] * 3 + [HELD] * 9) == []  # before it has settled
    leaking = [replace(HELD, memory_mb=800.0 + 20.0 * k, handles=190.0 + 4.0 * k) for k in range(12)]
    assert grown(leaking) == ["memory_mb: 880.0 to 1000.0"]
    more = [replace(HELD, processes=6.0 + (k > 8), latency_ms=20.0 * (1 + k)) for k in range(12)]
    assert grown(more) == ["processes: 6.0 to 7.0", "latency_ms: 100.0 to 220.0"]


@pytest.mark.slow
def test_a_camera_that_fails_again_and_again_leaves_nothing_behind(tmp_path: Path) -> None:
    looks = run(0.2, 1, tmp_path, period_s=6.0)
    assert 1 <= len(looks) <= len(FAULTS)
    # Three looks on a machine that does other work say nothing of latency.
    assert [one for one in grown(looks) if not one.startswith("latency")] == []
