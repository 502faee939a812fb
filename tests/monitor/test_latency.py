"""Stages of the way from capture to publication, and their budget."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lumpwatch.service.config.cameras import LatencyConfig
from lumpwatch.service.monitor.latency import LatencyTracker
from tests.protocol.test_messages import RESULT
from tests.service_helpers import frame

CONFIG = LatencyConfig(budget_s=0.5, for_s=2.0)


def test_the_stages_add_up() -> None:
    watch = LatencyTracker(CONFIG)
    watch.published(0.004)
    watch.decided(RESULT, 100.05)  # captured at 100, received at 100.02, taken at 100.03
    assert watch.last is not None
    told = watch.last
    assert (told.receive_s, told.bus_s, told.decision_s, told.publish_s) == pytest.approx(
        (0.02, 0.01, 0.02, 0.004)
    )
    assert told.total_s == pytest.approx(0.054)
    assert told.budget_s == 0.5


def test_a_result_without_a_frame_has_no_latency() -> None:
    watch = LatencyTracker(CONFIG)
    watch.decided(replace(RESULT, frame=None), 100.0)
    assert watch.last is None
    assert not watch.exhausted(1e9)


def test_only_a_delay_without_a_break_exhausts_the_budget() -> None:
    watch = LatencyTracker(CONFIG)

    def decide(at_s: float, late_s: float) -> bool:
        captured = at_s - late_s
        watch.decided(replace(RESULT, frame=frame(1, time_s=captured), taken_s=at_s - 0.01), at_s)
        return watch.exhausted(at_s)

    assert not any(decide(10.0 + k / 10, 0.6) for k in range(20))
    assert decide(12.0, 0.6)
    assert not decide(12.1, 0.5)  # the budget itself is in time
    assert not decide(12.2, 0.6)
    assert not decide(14.1, 0.6)
    assert decide(14.2, 0.6)
