from __future__ import annotations

from pathlib import Path

import pytest

from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import parse_config
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video

PRIOR = Path(__file__).parents[2] / "service" / "simulator" / "demo.prior"


@pytest.fixture(scope="session")
def feed_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """30 s of simulated feed whose first lump comes early."""
    spec = FeedSpec.from_query(FEED, seed=SEED)
    return write_video(spec, 30.0, tmp_path_factory.mktemp("feed")).video


@pytest.fixture(scope="session")
def polygon() -> str:
    roi = parse_config(demo_config(Path("var"), 0)).camera(CAMERA).roi(ROI)
    return str([list(point) for point in roi.polygon])
