"""The simulated mouth: it swallows, holds back, bridges and clears, and says so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lumpwatch.service.config import parse_config
from lumpwatch.service.simulator import FeedSimulator, FeedSpec, write_video

SMALL = {"width": 200, "height": 160, "fps": 5.0, "noise": 0.0, "dust": 0.0, "shake_px": 0.0, "flicker": 0.0,
         "light_drift": 0.0, "lumps_per_minute": 0.0, "medium_rocks_per_minute": 0.0}  # fmt: skip


def feed(**changed: object) -> FeedSimulator:
    return FeedSimulator(FeedSpec.model_validate({**SMALL, "seed": 3, **changed}))


def mouth(simulator: FeedSimulator) -> np.ndarray:
    picture, _ = simulator.render()
    lip, bottom = round(simulator.geometry.lip_row), simulator.geometry.rim_row
    top = (lip + bottom) // 2  # above it the belt ends, and what has just fallen is seen
    return picture[top:bottom].astype(int)


def differs(simulator: FeedSimulator, at_s: float) -> float:
    """How much the mouth changes from then to the next picture."""
    simulator.skip(round((at_s - simulator.time_s) * simulator.spec.fps))
    return float(np.abs(mouth(simulator) - mouth(simulator)).mean())


def test_without_its_options_there_is_none() -> None:
    plain = feed()
    assert not plain.spec.has_mouth
    assert (plain.mouth_at(30.0).level, plain.bridges, plain.lodged) == (0.0, (), ())


def test_it_stays_as_full_as_it_is_told_while_it_swallows() -> None:
    swallows = feed(mouth_level=0.4)
    for t in (0.0, 10.0, 60.0):
        assert swallows.mouth_at(t).level == pytest.approx(0.4, abs=0.02)
        assert swallows.mouth_at(t).standing == 0.0
    assert differs(swallows, 5.0) > 2.0


def test_a_bridge_stands_fills_up_and_breaks() -> None:
    bridges = feed(mouth_level=0.4, bridge_every_s=20.0, bridge_duration_s=15.0)
    bridges.mouth_at(200.0)
    first = bridges.bridges[0]
    assert first.until_s - first.from_s == 15.0
    begun, full = bridges.mouth_at(first.from_s + 0.5), bridges.mouth_at(first.until_s - 0.5)
    assert begun.bridged
    assert begun.standing == pytest.approx(begun.level)
    assert full.standing == 1.0
    after = bridges.mouth_at(first.until_s + 3.0)
    assert not after.bridged
    assert after.level < 0.6
    assert differs(bridges, first.until_s - 2.0) == 0.0
    assert differs(bridges, first.until_s + 0.2) > 2.0


def test_part_of_the_width_bridges() -> None:
    half = feed(mouth_level=0.4, bridge_every_s=20.0, bridge_duration_s=15.0, bridge_width=0.5)
    half.mouth_at(200.0)
    assert 0.4 < half.mouth_at(half.bridges[0].until_s - 0.5).standing <= 0.5
    assert differs(half, half.bridges[0].until_s - 2.0) > 1.0


def test_it_holds_back_for_a_moment_in_normal_crushing_and_empties_when_the_feed_stops() -> None:
    rests = feed(mouth_level=0.4, hesitate_every_s=10.0, hesitate_longest_s=3.0)
    held = [rests.mouth_at(0.1 * k) for k in range(1200)]
    shares = [truth.hesitates for truth in held]
    assert 0.03 < sum(shares) / len(shares) < 0.3
    longest = max(len(run) for run in "".join("x" if one else " " for one in shares).split())
    assert longest <= 31
    stops = feed(mouth_level=0.4, stop_every_s=20.0, stop_duration_s=30.0)
    assert min(stops.mouth_at(0.5 * k).level for k in range(240)) == 0.0


def test_what_happens_does_not_depend_on_when_it_is_asked_for() -> None:
    options = {"mouth_level": 0.3, "bridge_every_s": 10.0, "hesitate_every_s": 5.0}
    one, other = feed(**options), feed(**options)
    late = one.mouth_at(90.0)
    for k in range(0, 900, 7):
        other.mouth_at(0.1 * k)
    assert other.mouth_at(90.0) == late
    assert other.bridges == one.bridges
    one.skip(60)
    for _ in range(60):
        other.render()
    assert np.array_equal(one.render()[0], other.render()[0])


def test_lumps_lodge_stay_and_go_through() -> None:
    lumps = feed(lumps_per_minute=10.0, stuck_share=1.0, stuck_duration_s=4.0)
    seen: dict[int, list[float]] = {}
    for _ in range(150):
        t = lumps.time_s
        for truth in lumps.render()[1]:
            if not truth.on_belt:
                seen.setdefault(truth.id, []).append(t)
    assert lumps.lodged
    number, at, until = lumps.lodged[0]
    assert until - at == 4.0
    assert seen[number][0] <= at <= seen[number][-1]
    assert seen[number][-1] == pytest.approx(until, abs=0.6)


def test_simulate_writes_the_truth_and_a_region_that_watches_it(tmp_path: Path) -> None:
    spec = FeedSpec.model_validate(
        {**SMALL, "mouth_level": 0.4, "bridge_every_s": 2.0, "bridge_duration_s": 2.0}
    )
    write_video(spec, 8.0, tmp_path)
    about = json.loads((tmp_path / "spec.json").read_text())
    assert about["mouth"]["bridges"]
    assert len(about["mouth"]["polygon"]) == 4
    belt, region = parse_config((tmp_path / "site.yaml").read_text(), "site.yaml", {}).cameras[0].rois
    assert (belt.id, region.watch, region.mouth.belt) == ("apron", "mouth", "apron")
    assert min(y for _, y in region.polygon) == max(y for _, y in belt.polygon)
