"""A region in state LUMP lists an object that counts, or says why not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    Decision,
    DetectedObject,
    Detection,
    NotCounted,
    RoiResult,
)
from lumpwatch.service.protocol import state_line

FOUND = DetectedObject(1, 0.0, 0.0, 9.0, 9.0, 1.0, 1.0, 0.99, "belt")
SMALL = replace(FOUND, not_counted=NotCounted.TOO_SMALL)


@pytest.mark.parametrize(
    ("decision", "detection", "why"),
    [
        (Decision.LUMP, Detection(0.99, (FOUND,)), None),
        (Decision.LUMP, Detection(0.99, (SMALL, FOUND)), None),
        (Decision.LUMP, Detection(0.95, ()), "spread"),
        (Decision.LUMP, Detection(0.01, ()), "held"),
        (Decision.LUMP, Detection(0.0, (SMALL,)), "held"),
        (Decision.LUMP, None, "held"),
        (Decision.CLEAR, Detection(0.0, (SMALL,)), None),
        (Decision.BLIND, None, None),
    ],
)
def test_lump_without_an_object_says_why(
    decision: Decision, detection: Detection | None, why: str | None
) -> None:
    alarms = dict.fromkeys(AlarmClass, Alarm())
    result = RoiResult("apron", None, decision, None, detection, 0.9, alarms, 0, decided=True)
    line = state_line(result, "cam", 0.0)
    assert line.unlocated == why
    assert [one.counts for one in line.objects] == [
        one.counts for one in (detection.objects if detection else ())
    ]
