"""What a tracker and a histogram learned survives the prior's file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lumpwatch.models.learning import ForegroundChoice, HistogramFit, Noise, TrackerFit
from lumpwatch.models.trackers.imm_pf import LinearSize
from lumpwatch.models.trackers.scene import EmptyScene
from lumpwatch.service.config import ImmPfConfig
from lumpwatch.service.detection.choices import with_choices
from lumpwatch.service.storage import decode_prior, encode_prior
from tests.service_helpers import camera, learned, prior

SCENE = EmptyScene(
    np.full((6, 8, 3), 90, np.uint8), np.full((6, 8, 3), 4, np.uint8), np.eye(6, 8, dtype=np.uint8)
)
FIT = TrackerFit(
    noise=Noise(0.02, 0.06, 0.1),
    size=LinearSize(0.25, 0.04, 0.35, 0.1, 0.8),
    scene=SCENE,
    foreground=ForegroundChoice("mixture", 50.0),
    working_size_px=512,
)


def test_a_tracker_prior_is_read_as_it_was_written() -> None:
    kept = decode_prior(encode_prior(prior(replace(learned(), tracker=FIT))), "prior").learned.tracker
    assert kept is not None
    assert (kept.noise, kept.size, kept.foreground, kept.working_size_px) == (
        FIT.noise,
        FIT.size,
        FIT.foreground,
        512,
    )
    assert kept.scene is not None
    assert np.array_equal(kept.scene.picture, SCENE.picture)
    assert kept.scene.cover is not None
    assert SCENE.cover is not None
    assert np.array_equal(kept.scene.cover, SCENE.cover)
    assert decode_prior(encode_prior(prior(learned())), "prior").learned.tracker is None


def test_a_histogram_keeps_its_share() -> None:
    fit = HistogramFit(np.full(16, 1 / 16), 1.0, 2.0, "luma", 1.5)
    kept = decode_prior(encode_prior(prior(learned(likelihood=fit))), "prior").learned.likelihood
    assert isinstance(kept, HistogramFit)
    assert kept.evidence == 1.5


@pytest.mark.parametrize(
    ("configured", "size", "kind"),
    [
        ({}, 512, "mixture"),
        ({"working_size_px": 320}, 320, "mixture"),
        ({"foreground": {"kind": "statistical"}}, 512, "statistical"),
    ],
)
def test_what_is_configured_stays(configured: dict[str, object], size: int, kind: str) -> None:
    region = (
        camera()
        .rois[0]
        .model_copy(update={"detector": ImmPfConfig.model_validate({"kind": "imm_pf", **configured})})
    )
    chosen = with_choices(region, replace(learned(), tracker=FIT)).detector
    assert isinstance(chosen, ImmPfConfig)
    assert (chosen.working_size_px, chosen.background.kind) == (size, kind)
    assert with_choices(region, learned()) is region
