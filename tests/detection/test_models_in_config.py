"""Motion models by configuration: one's own, the learned motion prior, the order of drawing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lumpwatch.models.jdt.motion import FreeAcceleration
from lumpwatch.models.jdt.motion_prior import MotionPrior
from lumpwatch.models.roi import make_roi
from lumpwatch.models.state import VX, blank
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli.demo import CAMERA, ROI, demo_config
from lumpwatch.service.config import CameraConfig, JdtConfig, RoiConfig, parse_config
from lumpwatch.service.detection.detectors.filters import PriorMismatchError, make_filter
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.runtime.preflight import check_priors
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import WrittenFeed, write_video
from lumpwatch.service.storage.label_file import read_labels
from lumpwatch.service.storage.prior_file import Prior, PriorMeta, decode_prior, encode_prior
from lumpwatch.service.training.learner import Trained, train
from tests.own_model import Sliding

GEOMETRY = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], 320, 200, 320)


def roi_with(**detector: object) -> tuple[CameraConfig, RoiConfig]:
    camera = parse_config(demo_config(Path("var"), 0)).camera(CAMERA)
    roi = camera.roi(ROI).model_copy(update={"detector": JdtConfig.model_validate(detector)})
    return camera.model_copy(update={"rois": (roi,)}), roi


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> WrittenFeed:
    spec = FeedSpec.from_query("lumps_per_minute=20&seed=3&fps=10")
    return write_video(spec, 20.0, tmp_path_factory.mktemp("clip"))


HISTOGRAM = {"kind": "histogram", "evidence": 0.5}
"""Learned in a moment; what is learned of motion and places is the same for either likelihood."""


def trained_with(clip: WrittenFeed, **detector: object) -> Trained:
    camera, roi = roi_with(**detector, likelihood=HISTOGRAM, working_size_px=192, particles=50)
    frames, _ = read_frames(camera, clip.video)
    return train(roi, frames, read_labels(clip.labels), clip.labels, "clip")


def test_a_model_of_ones_own() -> None:
    own = {"name": "belt", "kind": "tests.own_model:Sliding", "parameters": {"friction_hz": 2.0}}
    config = JdtConfig.model_validate({"models": [own, "constant_velocity"]})
    model = make_filter(config, GEOMETRY, None).models[0]
    assert model == Sliding("belt", 200.0, friction_hz=2.0)
    states = blank(1000)
    states[:, VX] = 10.0
    moved = model.move(states, 1e6, np.random.default_rng(0))
    assert np.allclose(moved[:, VX], 0.0)


@pytest.mark.parametrize(
    ("model", "told"),
    [
        ({"name": "m", "kind": "no.such.module:Thing"}, "ModuleNotFoundError"),
        ({"name": "m", "kind": "tests.own_model:Missing"}, "AttributeError"),
        ({"name": "m", "kind": "tests.own_model:Sliding", "parameters": {"frictoin": 1.0}}, "frictoin"),
        ({"name": "m", "kind": "builtins:dict"}, "no method move"),
    ],
)
def test_a_model_of_ones_own_that_cannot_be_made(model: dict[str, object], told: str) -> None:
    config = JdtConfig.model_validate({"models": [model]})
    with pytest.raises(ConfigError, match=told) as error:
        make_filter(config, GEOMETRY, None)
    assert "motion model m" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_free_acceleration() -> None:
    model = {"name": "free", "kind": "free_acceleration", "acceleration_noise_h_s2": 0.5}
    assert make_filter(JdtConfig.model_validate({"models": [model]}), GEOMETRY, None).models == (
        FreeAcceleration("free", 100.0),
    )


def test_a_motion_prior_needs_training(tmp_path: Path) -> None:
    config = JdtConfig.model_validate({"models": ["motion_prior"]})
    with pytest.raises(PriorMismatchError, match="needs a prior"):
        make_filter(config, GEOMETRY, None)
    text = demo_config(tmp_path, 0).replace("alarm:", "detector: {models: [motion_prior]}\n        alarm:")
    with pytest.raises(ConfigError, match="motion_prior needs a prior"):
        check_priors(parse_config(text))


@pytest.mark.slow
def test_a_motion_prior_is_learned_stored_and_used(clip: WrittenFeed) -> None:
    accelerations = [{"name": name, "kind": "constant_acceleration"} for name in ("belt", "fall")]
    models = [*accelerations, {"name": "flow", "kind": "motion_prior"}]
    trained = trained_with(clip, models=models)
    _, roi = roi_with(models=models, likelihood=HISTOGRAM)
    meta = PriorMeta(
        camera=CAMERA,
        roi=ROI,
        created="2026-01-01T00:00:00Z",  # type: ignore[arg-type]
        polygon=roi.polygon,
        aspect=trained.width / trained.height,
        source="clip",
        frames=trained.frames,
    )
    learned = decode_prior(encode_prior(Prior(meta, trained.learned)), "prior").learned
    assert learned.cells is not None
    geometry = make_roi(roi.polygon, trained.width, trained.height, 320)
    assert isinstance(roi.detector, JdtConfig)
    model = make_filter(roi.detector, geometry, learned).models[2]
    assert isinstance(model, MotionPrior)
    # In the middle of the belt everything moves down the picture, as the belt does.
    states = blank(500)
    states[:, :2] = np.array(geometry.shape[::-1]) * [0.5, 0.4]
    moved = model.move(states, 0.1, np.random.default_rng(0))
    velocity = np.median(moved[:, 2:4], axis=0) / geometry.shape[0]
    assert velocity[1] == pytest.approx(0.09, abs=0.04)
    assert abs(velocity[0]) < 0.02


@pytest.mark.slow
def test_state_first_learns_where_the_next_step_changes(clip: WrittenFeed) -> None:
    """The label that goes with a place is that of one step later: falls begin one step further up."""
    falls = {}
    for order in ("model_first", "state_first"):
        density = trained_with(clip, order=order).learned.density
        rows = density.origin[0] + density.step[0] * np.arange(density.values.shape[1])
        weights = density.values[1]
        falls[order] = float(rows @ weights / weights.sum())
    assert falls["state_first"] < falls["model_first"]
