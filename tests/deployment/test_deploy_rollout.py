"""Rolling out and back on an engine in memory."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from lumpwatch.service.deployment.bundling import Bundle, bundle
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.deployment.plan import Action
from lumpwatch.service.deployment.rollout import Rollout
from tests.engine_fake import FakeEngine
from tests.service_helpers import site_tree

NAME, PREVIOUS, NEXT = "lumpwatch-pit", "lumpwatch-pit-previous", "lumpwatch-pit-next"


class Clock:
    """Time that passes in pauses only."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def pause(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def rollout(engine: FakeEngine, said: list[str]) -> Rollout:
    clock = Clock()
    return Rollout(engine, NAME, 10.0, said.append, clock, clock.pause)


@pytest.fixture
def wanted(tmp_path: Path) -> Callable[..., Bundle]:
    def make(raise_above: float = 0.9) -> Bundle:
        tree = site_tree()
        tree["cameras"][0]["source"]["url"] = "sim:feed"
        tree["cameras"][0]["rois"][0]["alarm"]["raise_above"] = raise_above
        (tmp_path / "site.yaml").write_text(json.dumps(tree))
        return bundle(tmp_path / "site.yaml", environ={})

    return make


def test_up_twice_does_nothing_the_second_time(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle]
) -> None:
    assert rollout.up("good-1", wanted()).action is Action.CREATE
    done = list(engine.done)
    assert rollout.up("good-1", wanted()).action is Action.NOTHING
    assert engine.done == done
    engine.stop(NAME)
    assert rollout.up("good-1", wanted()).action is Action.START
    assert engine.running() == [NAME]


@pytest.mark.parametrize("raise_above", [0.9, 0.8])
def test_another_image_or_configuration_replaces_and_keeps_the_one_before(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle], raise_above: float
) -> None:
    rollout.up("good-1", wanted())
    rollout.up("good-2", wanted(raise_above))
    assert engine.running() == [NAME]
    assert engine.containers[NAME].image == "good-2"
    assert engine.containers[PREVIOUS].image == "good-1"
    rollout.up("good-3", wanted())
    assert engine.containers[PREVIOUS].image == "good-2"
    assert set(engine.containers) == {NAME, PREVIOUS}
    rollout.rollback()
    assert engine.running() == [NAME]
    assert (engine.containers[NAME].image, engine.containers[PREVIOUS].image) == ("good-2", "good-3")
    rollout.rollback()
    assert (engine.containers[NAME].image, engine.containers[PREVIOUS].image) == ("good-3", "good-2")


@pytest.mark.parametrize(
    ("image", "told"),
    [
        ("blind", "10 s: cam/lip: "),
        ("mute", "it does not answer"),
        ("ends", "bus.listen: .*tcp/127.0.0.1:7447"),
    ],
)
def test_a_bad_one_goes_back_by_itself(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle], image: str, told: str
) -> None:
    rollout.up("good-0", wanted())
    rollout.up("good-1", wanted())
    with pytest.raises(DeployError, match=f"{told}.*went back .*ready"):
        rollout.up(image, wanted())
    assert engine.running() == [NAME]
    assert engine.containers[NAME].image == "good-1"
    assert engine.containers[PREVIOUS].image == "good-0"  # what could be gone back to before, still can
    assert NEXT not in engine.containers


def test_what_the_image_refuses_never_stops_the_one_that_runs(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle]
) -> None:
    rollout.up("good-1", wanted())
    with pytest.raises(DeployError, match="unknown key"):
        rollout.up("refuses", wanted())
    assert f"stop {NAME}" not in engine.done
    assert engine.running() == [NAME]


def test_a_region_that_was_dead_before_does_not_stop_an_upgrade(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle], said: list[str]
) -> None:
    with pytest.raises(DeployError, match="left as it is"):
        rollout.up("half-1", wanted())
    rollout.up("half-2", wanted())
    assert engine.containers[NAME].image == "half-2"
    assert any("as before, not ready: cam/lip" in line for line in said)
    with pytest.raises(DeployError, match="cam/apron"):
        rollout.up("blind", wanted())
    assert engine.running() == [NAME]
    assert engine.containers[NAME].image == "half-2"


def test_a_first_one_that_ends_is_cleared_away(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle]
) -> None:
    with pytest.raises(DeployError, match=r"cannot listen on .*removed"):
        rollout.up("ends", wanted())
    assert engine.containers == {}


def test_an_interrupt_goes_back_as_well(engine: FakeEngine, wanted: Callable[..., Bundle]) -> None:
    def interrupt(seconds: float) -> None:
        if engine.found(NEXT) is not None and engine.found(NEXT).running:  # type: ignore[union-attr]
            raise KeyboardInterrupt

    rollout = Rollout(engine, NAME, 10.0, print, Clock(), interrupt)
    rollout.up("good-1", wanted())
    with pytest.raises(KeyboardInterrupt):
        rollout.up("blind", wanted())
    assert engine.running() == [NAME]
    assert engine.containers[NAME].image == "good-1"


def test_what_a_killed_roll_out_left_is_cleared_away(
    engine: FakeEngine, rollout: Rollout, wanted: Callable[..., Bundle]
) -> None:
    rollout.up("good-1", wanted())
    engine.stop(NAME)
    engine.create(NEXT, "good-2", wanted())
    engine.start(NEXT)  # killed on trial: the old one is started again
    engine.stop(NEXT)
    rollout.up("good-1", wanted())
    assert engine.running() == [NAME]
    assert NEXT not in engine.containers

    engine.rename(NAME, PREVIOUS)  # killed between the two renamings
    engine.stop(PREVIOUS)
    engine.create(NEXT, "good-2", wanted())
    engine.start(NEXT)
    assert rollout.up("good-2", wanted()).action is Action.NOTHING
    assert engine.running() == [NAME]
    assert engine.containers[PREVIOUS].image == "good-1"


def test_nothing_to_go_back_to(rollout: Rollout, wanted: Callable[..., Bundle]) -> None:
    rollout.up("good-1", wanted())
    with pytest.raises(DeployError, match="no earlier container"):
        rollout.rollback()
