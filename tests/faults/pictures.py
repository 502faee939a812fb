"""What the tests of faults between camera and filter share."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.core.video_writer import Codec, VideoWriter
from lumpwatch.service.storage.prior_store import PriorStore
from tests.faults.outside import BLIND_AFTER_S, NOTICED_S, Outside
from tests.faults.table import Row
from tests.integration.site import Daemon
from tests.service_helpers import HEIGHT, WIDTH, picture, prior, site_tree

FPS = 10.0
DARK_S, BRIGHT_S = 1.5, 1.5
RECOVERED_S = 15.0


def write_clip(path: Path, scale: int = 1, codec: Codec = "h264") -> Path:
    """Dark ground, then the object in it; the ground flickers, so no two pictures are alike."""
    rng = np.random.default_rng(1)
    with VideoWriter(path, scale * WIDTH, scale * HEIGHT, FPS, codec=codec, gop=5) as writer:
        for k in range(round((DARK_S + BRIGHT_S) * FPS)):
            shown = picture(bright=k >= DARK_S * FPS)
            shown = np.minimum(shown, 245) + rng.integers(0, 10, shown.shape).astype(np.uint8)
            writer.write(np.repeat(np.repeat(shown, scale, axis=0), scale, axis=1))
    return path


def camera(name: str, url: str, **source: Any) -> str:
    """A camera whose pictures are those of `write_clip`."""
    (one,) = site_tree(particles=100)["cameras"]
    one |= {"id": name, "blind_after_s": BLIND_AFTER_S}
    one["source"] = {
        "url": url,
        "open_timeout_s": 4.0,
        "read_timeout_s": 1.5,
        "backoff": {"initial_s": 0.2, "max_s": 1.0},
    } | source
    one["rois"][0]["alarm"] = {
        "latch": False,
        "off_delay_s": 0.3,
        "blind": {"on_delay_s": 0.5, "off_delay_s": 0.3, "window_s": 1.5},
    }
    return f"  - {json.dumps(one)}\n"


@dataclass
class Pictures:
    """The daemon and one who looks on."""

    daemon: Daemon
    outside: Outside

    @property
    def store(self) -> Path:
        return load_config(self.daemon.config).store.path

    def metric(self, name: str, of: str, **labels: str) -> float:
        return self.daemon.metric(name, camera=of, **labels)


@contextmanager
def watching(folder: Path, cameras: dict[str, str], waits_for: tuple[str, ...]) -> Iterator[Pictures]:
    """A daemon with these cameras (`camera`), once those that are waited for decide."""
    daemon = Daemon(folder, "".join(cameras.values()))
    config = load_config(daemon.config)
    for name in cameras:
        PriorStore(config.store.path).save(prior(camera_id=name))
    with daemon, open_client(as_client(config.bus)) as bus:
        outside = Outside(bus)
        for name in waits_for:
            outside.sees(name, 0.0)
        yield Pictures(daemon, outside)
        assert daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()


@dataclass
class Course:
    """When what happened."""

    noticed_s: float
    recovered_s: float
    lost: int
    reason: str | None


def run_fault(
    site: Pictures,
    of: str,
    fault: Callable[[], object],
    noticed: Callable[[], object] = lambda: None,
    end: Callable[[], object] = lambda: None,
) -> Course:
    """Do the fault, wait for BLIND and for `noticed`, end it, and wait until a lump is announced again."""
    outside = site.outside
    outside.sees(of, time.monotonic())
    fault()
    began = time.monotonic()
    blind = outside.wait(of, "BLIND", since_s=began)
    noticed()
    ended = time.monotonic()
    end()
    back = outside.sees(of, max(ended, blind.at_s))
    outside.never_clear(of, began, back.at_s)
    outside.raised(of, back.at_s)
    return Course(
        blind.at_s - began, back.at_s - max(ended, blind.at_s), outside.lost(site.store, of), blind.reason
    )


def row(fault: str, done: str, noticed_by: str, recovery: str, course: Course) -> Row:
    by = f"BLIND ({course.reason}), {noticed_by}"
    return Row(
        fault, done, by, course.noticed_s, NOTICED_S, course.lost, recovery, course.recovered_s, RECOVERED_S
    )


def failures(site: Pictures, of: str, reason: str) -> Callable[[], float]:
    """How often the source has failed so."""
    return lambda: site.metric("lumpwatch_source_failures_total", of, reason=reason)
