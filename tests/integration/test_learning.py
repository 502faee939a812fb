"""Train on one simulated feed, replay others of another seed."""

from __future__ import annotations

from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config import load_config
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import WrittenFeed, write_video
from lumpwatch.service.storage.prior_store import PriorStore
from tests.reproduction.lumps import alarms_on, announcements, read_states

pytestmark = pytest.mark.slow

TRAINING_SEED = 1


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, polygon: str) -> Path:
    folder = tmp_path_factory.mktemp("site")
    config = folder / "site.yaml"
    config.write_text(
        f"""\
site: test
cameras:
  - id: crusher-1
    source: {{url: "sim:feed"}}
    rois: [{{id: apron, polygon: {polygon}, alarm: {{latch: false}}}}]
"""
    )
    clip = write_video(FeedSpec(seed=TRAINING_SEED), 60.0, folder)
    where = ["--camera", "crusher-1", "--roi", "apron"]
    assert main(["train", str(config), str(clip.video), str(clip.labels), "--folds", "0", *where]) == 0
    return config


@pytest.mark.parametrize("seed", [24, 33])
def test_every_lump_is_announced_before_it_falls(site: Path, tmp_path: Path, seed: int) -> None:
    """Both seeds hold eight lumps, all of which fall within the minute."""
    spec = FeedSpec(seed=seed)
    clip: WrittenFeed = write_video(spec, 60.0, tmp_path)
    assert main(["replay", str(site), str(clip.video), "--camera", "crusher-1", "--out", str(tmp_path)]) == 0
    found = announcements(read_states(tmp_path / "states.jsonl"), clip.labels, spec.fps)
    print(*found, sep="\n")
    assert len(found) == 8
    assert all(one.warned_s is not None and one.warned_s >= 1.0 for one in found)


def test_a_feed_without_lumps_raises_no_alarm_in_two_minutes(site: Path) -> None:
    camera = load_config(site).camera("crusher-1")
    prior = PriorStore(load_config(site).store.path).current("crusher-1", "apron").prior
    assert prior is not None
    assert alarms_on(camera, prior, FeedSpec(seed=50, lumps_per_minute=0.0), 120.0) == 0
