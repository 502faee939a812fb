"""New priors, references and shadows are seen, damaged ones counted, and no disk holds anything up."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry

from lumpwatch.service.monitor.artifacts import (
    HUNG_S,
    Artifact,
    ArtifactWatcher,
    NewPrior,
    NewReference,
    NewShadow,
)
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.reference_store import ReferenceStore
from lumpwatch.service.telemetry import MonitorMetrics
from tests.integration.site import wait_for
from tests.service_helpers import prior


class Watched:
    """A store that is watched, and what is counted of it."""

    def __init__(self, root: Path, priors: PriorStore | None = None, poll_s: float = 0.01) -> None:
        self.priors = priors or PriorStore(root)
        self.registry = CollectorRegistry()
        self.now_s = 100.0
        self.watcher = ArtifactWatcher(
            camera="cam",
            rois=("apron",),
            priors=self.priors,
            references=ReferenceStore(root),
            poll_s=poll_s,
            metrics=MonitorMetrics(self.registry, "cam", ("apron",)),
            clock=lambda: self.now_s,
        )

    def problems(self, metric: str) -> float:
        found = self.registry.get_sample_value(
            f"lumpwatch_{metric}_total", {"camera": "cam", "roi": "apron", "reason": "unreadable"}
        )
        return found or 0.0


@pytest.fixture
def watched(tmp_path: Path) -> Watched:
    return Watched(tmp_path)


def versions(found: tuple[Artifact, ...]) -> list[tuple[str, int | None]]:
    """Kind and version, None for none."""
    told: list[tuple[str, int | None]] = []
    for one in found:
        used = one.reference if isinstance(one, NewReference) else one.prior
        told.append((type(one).__name__, None if used is None else used.version))
    return told


def damage(store: PriorStore, version: int) -> None:
    path = store.path("cam", "apron", version)
    path.write_bytes(path.read_bytes()[:-7])


def test_a_new_prior_is_seen_once(watched: Watched) -> None:
    assert watched.watcher.first() == ()
    assert watched.watcher.poll() == ()
    watched.priors.save(prior())
    assert versions(watched.watcher.poll()) == [("NewPrior", 1)]
    assert watched.watcher.poll() == ()
    watched.priors.save(prior())
    watched.priors.use("cam", "apron", 1)
    assert watched.watcher.poll() == ()
    watched.priors.use("cam", "apron", 2)
    assert versions(watched.watcher.poll()) == [("NewPrior", 2)]
    assert watched.problems("prior_problems") == 0


def test_going_back_to_the_defaults_is_seen(watched: Watched) -> None:
    watched.priors.save(prior())
    assert versions(watched.watcher.first()) == [("NewPrior", 1)]
    watched.priors.use_defaults("cam", "apron")
    assert watched.watcher.poll() == (NewPrior("apron", None),)
    assert watched.watcher.poll() == ()
    watched.priors.use("cam", "apron", 1)
    assert versions(watched.watcher.poll()) == [("NewPrior", 1)]


def test_a_damaged_prior_is_counted_and_passed_over(watched: Watched) -> None:
    watched.priors.save(prior())
    watched.priors.save(prior())
    damage(watched.priors, 2)
    assert versions(watched.watcher.first()) == [("NewPrior", 1)]
    assert watched.problems("prior_problems") == 1


def test_a_store_that_cannot_be_read_is_counted(watched: Watched) -> None:
    folder = watched.priors.folder("cam", "apron")
    folder.parent.mkdir(parents=True)
    folder.write_text("not a folder")
    assert watched.watcher.first() == ()
    assert watched.problems("prior_problems") == 1


def test_a_shadow_comes_and_goes(watched: Watched) -> None:
    watched.priors.save(prior())
    watched.priors.save(prior(), shadow=True)
    assert versions(watched.watcher.first()) == [("NewPrior", 1), ("NewShadow", 2)]
    assert watched.watcher.poll() == ()
    watched.priors.drop_shadow("cam", "apron")
    assert watched.watcher.poll() == (NewShadow("apron", None),)
    assert watched.watcher.poll() == ()


def test_a_damaged_shadow_is_counted_and_none_runs(watched: Watched) -> None:
    watched.priors.save(prior())
    watched.priors.save(prior(), shadow=True)
    damage(watched.priors, 2)
    assert versions(watched.watcher.first()) == [("NewPrior", 1), ("NewShadow", None)]
    assert watched.problems("shadow_failures") == 1


def test_what_the_thread_finds_is_handed_over(watched: Watched) -> None:
    watched.watcher.first()
    watched.watcher.start()
    watched.priors.save(prior())
    found = wait_for("found", watched.watcher.take, 30)
    watched.watcher.close()
    assert versions(found) == [("NewPrior", 1)]


class HungStore(PriorStore):
    """A store on a disk that hangs, from the moment that `hangs` is set until `released` is."""

    hangs = threading.Event()
    released = threading.Event()
    asked = threading.Event()

    def pointer(self, camera: str, roi: str) -> int | None:
        if self.hangs.is_set():
            self.asked.set()
            self.released.wait(60)
        return super().pointer(camera, roi)


@pytest.fixture
def hung(tmp_path: Path) -> Iterator[HungStore]:
    yield HungStore(tmp_path)
    HungStore.released.set()
    for event in (HungStore.hangs, HungStore.asked):
        event.clear()


def test_a_disk_that_hangs_is_told_and_waited_for_by_nobody(
    tmp_path: Path, hung: HungStore, caplog: pytest.LogCaptureFixture
) -> None:
    HungStore.released.clear()
    watched = Watched(tmp_path, hung)
    watched.watcher.first()
    hung.hangs.set()
    watched.watcher.start()
    assert hung.asked.wait(10)
    assert watched.watcher.take() == ()  # it would wait for a minute
    assert caplog.text == ""
    watched.now_s += HUNG_S
    for _ in range(3):
        assert watched.watcher.take() == ()
    assert caplog.text.count("the store has not answered") == 1
    hung.hangs.clear()
    PriorStore(tmp_path).save(prior())
    hung.released.set()
    found = wait_for("found", watched.watcher.take, 30)
    watched.watcher.close()
    assert versions(found) == [("NewPrior", 1)]
