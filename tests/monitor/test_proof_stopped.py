"""A proof test that the end of the daemon cuts short says nothing of the chain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import Bus, BusClosed
from lumpwatch.service.bus.endpoints import Reply
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.config.proof import ProofTestConfig
from lumpwatch.service.core import FeedState, LumpCut
from lumpwatch.service.core.clock import Clocks
from lumpwatch.service.core.decision import Decision
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.monitor.proof.chain import ProofTest, Site
from lumpwatch.service.monitor.proof.keeper import ProofKeeper
from lumpwatch.service.monitor.proof.lumps import as_message
from lumpwatch.service.protocol.proof import SHOWS_DRAWN, SHOWS_LABELLED, BlendPlan, Outcome, ProofReason
from lumpwatch.service.telemetry.proof import ProofMetrics
from tests.service_helpers import HEIGHT, WIDTH, camera, frame, prior


class Inbox:
    """Gives frames until it has none; then it does what it was told."""

    same_clock = True

    def __init__(self, end: Callable[[], Frame | None]) -> None:
        self._frames = [frame(k) for k in range(3)]
        self._end = end

    def take(self, timeout_s: float) -> Frame | None:
        return self._frames.pop(0) if self._frames else self._end()

    def close(self) -> None:
        """Nothing to let go of."""


class FakeBus:
    """A bus whose camera answers or not, and whose frames end."""

    def __init__(self, end: Callable[[], Frame | None], *, answers: bool = True) -> None:
        self._end, self._answers = end, answers
        self.asked: list[BlendPlan] = []

    def alarm_publisher(self, key: str) -> None:
        """None: no alarm comes."""

    def frame_inbox(self, key: str) -> Inbox:
        return Inbox(self._end)

    def ask(self, key: str, *, payload: bytes, **_: Any) -> list[Reply]:
        self.asked.append(BlendPlan.model_validate_json(payload))
        return [Reply(key, b"{}", None)] if self._answers else []


class Stop:
    """Whether the daemon stops, now or a little later."""

    def __init__(self, *, after_s: float = float("inf")) -> None:
        self.after_s = after_s

    def __call__(self, within_s: float = 0.0) -> bool:
        return within_s >= self.after_s


def closed() -> Frame | None:
    raise BusClosed("closed")


def silent() -> Frame | None:
    return None


def broken() -> Frame | None:
    raise ValueError("a frame that makes no sense")


def proof(
    bus: FakeBus,
    stop: Stop,
    feed: FeedState = FeedState.RUNNING,
    lumps: Sequence[LumpCut] = (),
    config: CameraConfig | None = None,
) -> ProofTest:
    watched = Site(
        size=lambda: (WIDTH, HEIGHT),
        prior=lambda roi: prior(),
        decision=lambda roi: Decision.CLEAR,
        stopped=stop,
        feed=lambda roi: feed,
    )
    config = (config or camera()).model_copy(update={"blind_after_s": 0.0})
    return ProofTest("pit", config, cast("Bus", bus), watched, lambda *_: lumps)


def test_the_result_says_which_lump_was_shown_and_what_that_means() -> None:
    cut = LumpCut("lump 3 of a.mp4", np.full((8, 12), 90, np.uint8), (0.5, 0.5, 0.2, 0.1), (100.0, 20.0))
    bus = FakeBus(silent)
    shown = proof(bus, Stop(), lumps=[cut]).run("apron", "")
    drawn = proof(bus, Stop()).run("apron", "")
    roi = camera().rois[0]
    wanted = roi.model_copy(update={"proof_test": ProofTestConfig(lump="drawn")})
    config = camera().model_copy(update={"rois": (wanted,)})
    asked_for = proof(bus, Stop(), lumps=[cut], config=config).run("apron", "")
    assert [(one.lump, one.shows) for one in (shown, drawn, asked_for)] == [
        ("lump 3 of a.mp4", SHOWS_LABELLED),
        ("", SHOWS_DRAWN),
        ("", SHOWS_DRAWN),
    ]
    assert [plan.lump for plan in bus.asked] == [as_message(cut), None, None]
    again = proof(bus, Stop(), lumps=[cut, replace(cut, name="b")]).run("apron", "", shown)
    assert (shown.outcome, again.lump) == (Outcome.FAILED, "lump 3 of a.mp4")


@pytest.mark.parametrize(
    ("bus", "failure"),
    [
        (FakeBus(silent, answers=False), ProofReason.NO_CAMERA),
        (FakeBus(silent), ProofReason.NO_FRAMES),
        (FakeBus(broken), ProofReason.ERROR),
    ],
    ids=["no answer", "no frames", "error"],
)
def test_what_breaks_because_the_daemon_stops_is_no_failure(bus: FakeBus, failure: ProofReason) -> None:
    """The camera's process may be told to stop a moment before the monitor is."""
    stopping = proof(bus, Stop(after_s=0.5)).run("apron", "")
    assert (stopping.outcome, stopping.reason) == (Outcome.INCONCLUSIVE, ProofReason.STOPPED)
    running = proof(bus, Stop()).run("apron", "")
    assert (running.outcome, running.reason) == (Outcome.FAILED, failure)


def test_an_empty_belt_is_no_place_for_a_proof_test() -> None:
    found = proof(FakeBus(broken), Stop(), FeedState.EMPTY).run("apron", "")
    assert (found.outcome, found.reason) == (Outcome.INCONCLUSIVE, ProofReason.EMPTY)


def test_a_bus_that_closes_is_the_end_of_the_daemon() -> None:
    found = proof(FakeBus(closed), Stop()).run("apron", "ada")
    assert (found.outcome, found.reason, found.actor) == (Outcome.INCONCLUSIVE, ProofReason.STOPPED, "ada")


def test_nothing_of_it_is_stored(tmp_path: Path) -> None:
    test = proof(FakeBus(closed), Stop())
    metrics = ProofMetrics(CollectorRegistry(), "cam", ("apron",))
    keeper = ProofKeeper(camera(), tmp_path, test.run, metrics, lambda: Clocks(50.0, 1.7e9))
    keeper.test("apron", "ada")
    assert not any(keeper.troubles("apron").values())
    assert not list(tmp_path.rglob("*.json"))
