"""Training on a simulated clip: what is learned agrees with the labels; what is wrong is named."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.state import VX, VY
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.label_file import Box, LabelError, read_labels
from lumpwatch.service.training.footage import TrainingError
from lumpwatch.service.training.learner import Trained, train
from tests.service_helpers import frame, site, site_tree

SECONDS, FPS = 20.0, 15.0
QUICK = {"kind": "lump", "evidence": 0.8}
"""With a given share of evidence, training does not look for it."""
CHEAP: dict[str, Any] = {"likelihood": {"kind": "histogram", "evidence": 0.5}, "particles": 50}
"""For what is learned of motion and places, whatever the likelihood."""


@dataclass(frozen=True)
class Clip:
    """A simulated clip, its labels, and a camera for it."""

    video: Path
    labels: Path
    camera: CameraConfig
    boxes: tuple[Box, ...]

    def train(
        self, boxes: tuple[Box, ...] | None = None, seconds: float = SECONDS, **detector: Any
    ) -> Trained:
        """Learn from the first seconds, with the boxes of the clip or others."""
        camera = self.camera
        if detector:
            roi = camera.rois[0]
            changed = roi.model_copy(update={"detector": site_roi(roi.polygon, **detector).detector})
            camera = camera.model_copy(update={"rois": (changed,)})
        frames, _ = read_frames(camera, self.video)
        count = round(seconds * FPS)
        chosen = tuple(b for b in self.boxes if b.frame <= count) if boxes is None else boxes
        return train(camera.rois[0], islice(frames, count), chosen, self.labels, self.video.name)


def site_roi(polygon: Any, **detector: Any) -> Any:
    tree = site_tree()
    tree["cameras"][0]["rois"][0] |= {"polygon": polygon, "detector": detector}
    return site(tree).cameras[0].rois[0]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    spec = FeedSpec(seed=3, width=320, height=240, fps=FPS, lumps_per_minute=24)
    written = write_video(spec, SECONDS, tmp_path_factory.mktemp("clip"))
    polygon = json.loads(written.spec.read_text())["polygon"]
    tree = site_tree()
    tree["cameras"][0]["rois"][0] |= {
        "polygon": polygon,
        "detector": {"working_size_px": 192, "likelihood": QUICK},
    }
    return Clip(written.video, written.labels, site(tree).cameras[0], read_labels(written.labels))


@pytest.fixture(scope="module")
def given(clip: Clip) -> Trained:
    """Learned with the models that column 10 gives."""
    return clip.train()


@pytest.fixture(scope="module")
def inferred(clip: Clip) -> Trained:
    """Learned from the boxes alone."""
    return clip.train(tuple(replace(box, model=None) for box in clip.boxes), working_size_px=192, **CHEAP)


pytestmark = pytest.mark.slow


def test_models_are_inferred_from_the_boxes(given: Trained, inferred: Trained) -> None:
    truth = given.samples.given
    assert (truth >= 0).all()
    assert set(truth) == {0, 1}
    assert (inferred.samples.given == -1).all()
    labels = inferred.motion.labels
    assert len(labels) == len(truth)
    assert (labels == truth).mean() >= 0.9
    falls = truth == 1
    # Falls are rare: agreement must not come from calling everything belt.
    assert (labels[falls] == 1).mean() >= 0.5


def test_given_models_are_kept(given: Trained) -> None:
    assert np.array_equal(given.motion.labels, given.samples.given)
    assert list(given.learned.label_counts) == list(np.bincount(given.samples.given))


def test_the_facts_of_the_clip(given: Trained) -> None:
    assert (given.width, given.height, given.frames) == (320, 240, round(SECONDS * FPS))
    assert given.learned.interval_s == pytest.approx(1 / FPS)
    assert given.learned.models == ("belt", "fall")
    assert given.learned.rates[1, 1] > 5 * abs(given.learned.rates[0, 1])  # what falls gains speed
    assert given.learned.joint.sum() == pytest.approx(1.0)
    assert given.learned.births.sum() == pytest.approx(1.0)


def test_size_and_velocity_by_row_agree_with_the_labels(given: Trained, clip: Clip) -> None:
    """Against plain medians of the boxes near a row, in ROI heights."""
    tracks: dict[int, list[Box]] = {}
    for box in clip.boxes:
        tracks.setdefault(box.track, []).append(box)
    corners = np.array(clip.camera.rois[0].polygon) * (320, 240)
    top, height = corners[:, 1].min(), float(np.ptp(corners[:, 1]))
    rows, sizes, speeds = [], [], []
    for boxes in tracks.values():
        for before, after in zip(boxes[:-5], boxes[5:], strict=True):
            if after.frame - before.frame != 5 or after.model == "fall":
                continue
            rows.append((before.y + before.h / 2 + after.y + after.h / 2) / 2)
            sizes.append((np.sqrt(before.w * after.w), np.sqrt(before.h * after.h)))
            speeds.append((after.y + after.h / 2 - before.y - before.h / 2) * FPS / 5)
    row, size, speed = np.array(rows), np.array(sizes) / height, np.array(speeds) / height
    at = np.array([0.2, 0.35, 0.5])  # far from the lip, where falling begins
    mean, spread = given.learned.profile.at(at)
    for k, place in enumerate(at):
        near = np.abs((row - top) / height - place) < 0.05
        assert near.sum() > 20
        assert np.exp(mean[k, 2:]) == pytest.approx(np.median(size[near], axis=0), rel=0.2)
        assert mean[k, 1] == pytest.approx(np.median(speed[near]), rel=0.2)
        assert (spread[k] > 0).all()
    assert np.ptp(spread[:, 2:], axis=0) == pytest.approx(
        0.0
    )  # pooled: no row knows how much the next ones differ
    assert (np.diff(mean[:, 1]) > 0).all()  # nearer to the camera everything is larger and faster
    assert (np.diff(mean[:, 2]) > 0).all()


def test_training_is_repeatable(clip: Clip) -> None:
    """With looks a second to find, and a margin that is given."""
    first, again = (
        clip.train(
            seconds=10.0, working_size_px=96, particles=300, likelihood={"kind": "lump", "margin": 2.0}
        )
        for _ in range(2)
    )
    assert np.array_equal(again.learned.density.values, first.learned.density.values)
    assert again.learned.likelihood.__class__ is first.learned.likelihood.__class__
    for name in ("mean", "scale", "weights", "offset", "looks_per_s"):
        assert np.array_equal(
            getattr(again.learned.likelihood, name), getattr(first.learned.likelihood, name)
        )
    assert np.array_equal(again.samples.states[:, [VX, VY]], first.samples.states[:, [VX, VY]])


def test_a_histogram_is_learned_where_the_configuration_asks_for_it(clip: Clip) -> None:
    trained = clip.train(likelihood={"kind": "histogram"}, working_size_px=96)
    fit = trained.learned.likelihood
    assert getattr(fit, "reference").sum() == pytest.approx(1.0)  # noqa: B009


def test_few_objects_are_warned_of(clip: Clip) -> None:
    first = min(box.track for box in clip.boxes)
    few = tuple(box for box in clip.boxes if box.track == first and box.model == "belt")
    warnings = clip.train(few, **CHEAP).warnings
    assert any("only 1 labelled objects" in warning for warning in warnings)
    assert any("motion model fall was seen in 0 steps" in warning for warning in warnings)


# What is wrong is named


def test_labels_of_frames_that_do_not_exist(clip: Clip) -> None:
    beyond = (*clip.boxes, replace(clip.boxes[-1], frame=301))
    with pytest.raises(LabelError, match=r"gt\.txt: .*frame 301\b.*video\.mp4 .*300"):
        clip.train(beyond)


def test_a_motion_model_that_is_not_configured(clip: Clip) -> None:
    wrong = (*clip.boxes[:-1], replace(clip.boxes[-1], model="roll"))
    with pytest.raises(LabelError, match=r"'roll' .*belt, fall$"):
        clip.train(wrong)


def test_no_label_in_the_region(clip: Clip) -> None:
    away = tuple(replace(box, x=1.0, y=230.0, w=4.0, h=4.0) for box in clip.boxes)
    with pytest.raises(LumpwatchError, match=r"gt\.txt: .*inside roi apron$"):
        clip.train(away)


def test_labels_of_single_frames(clip: Clip) -> None:
    with pytest.raises(TrainingError, match=r"gt\.txt: .*three consecutive"):
        clip.train(tuple(box for box in clip.boxes if box.frame % 2))


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([], "fewer than two frames"),
        ([frame(0)], "fewer than two frames"),
        ([frame(0, time_s=1.0), frame(1, time_s=1.0), frame(2, time_s=1.0)], "no advancing time stamps"),
        ([frame(0, size=(12, 8))], "roi apron: the region is only"),
    ],
)
def test_frames_that_cannot_be_used(frames: list[Frame], reason: str) -> None:
    boxes = (Box(1, 1, 40.0, 20.0, 10.0, 10.0, None),)
    with pytest.raises(TrainingError, match=reason):
        train(site(site_tree()).cameras[0].rois[0], frames, boxes, Path("gt.txt"), "clip.mp4")
