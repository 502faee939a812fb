"""Refining: clips joined into one recording, the footage that is kept for it, and the command."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli import main
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.footage_archive import FootageArchive
from lumpwatch.service.storage.label_file import Box, read_labels
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.versions import StoreError
from lumpwatch.service.training.footage import TrainingError
from lumpwatch.service.training.learner import train
from lumpwatch.service.training.refining import (
    PAUSE_S,
    ConfirmedClip,
    joined_footage,
    recorded_clip,
    refine,
)
from tests.service_helpers import frame, same, site, site_tree

OF = ("cam", "apron")
SMALL = {"working_size_px": 160, "likelihood": {"kind": "lump", "evidence": 0.8}}
"""With a given share of evidence, training does not look for it."""


def box(number: int, track: int, model: str | None = None) -> Box:
    return Box(number, track, 1.0, 2.0, 3.0, 4.0, model)


def clip(
    name: str, count: int, *boxes: Box, start_s: float = 0.0, interval_s: float = 0.1, **size: Any
) -> ConfirmedClip:
    frames = [frame(k, time_s=start_s + k * interval_s, **size) for k in range(count)]
    return ConfirmedClip(name, boxes, lambda: iter(frames))


# Joining


def test_clips_are_joined_into_one_recording() -> None:
    first = clip("a", 3, box(1, 7), box(2, 7), box(3, 9), start_s=5.0)
    nothing = clip("b", 2, start_s=100.0)
    last = clip("c", 4, box(2, 7, "belt"), box(4, 2), start_s=1.0)
    frames, boxes = joined_footage([first, nothing, last])
    seen = list(frames)
    assert [one.seq for one in seen] == list(range(9))
    # 0.2 s, a pause, 0.1 s, a pause, 0.3 s.
    b, c = 0.2 + PAUSE_S, 0.3 + 2 * PAUSE_S
    expected = [0.0, 0.1, 0.2, b, b + 0.1, c, c + 0.1, c + 0.2, c + 0.3]
    assert [one.capture_s for one in seen] == pytest.approx(expected)
    # Frames 1 to 3, 4 and 5, 6 to 9; tracks 7 and 9 of the first are 1 and 2, 2 and 7 of the last 3 and 4.
    assert boxes == (box(1, 1), box(2, 1), box(3, 2), box(7, 4, "belt"), box(9, 3))


def test_a_clip_of_more_frames_a_second_is_thinned() -> None:
    """As one of before a region was decided on every second frame."""
    fast = clip("a", 7, box(2, 3), box(3, 3), box(5, 3), interval_s=0.04)
    slow = clip("b", 3, box(2, 1), interval_s=0.08, start_s=9.0)
    frames, boxes = joined_footage([fast, slow])
    pause_s = 0.24 + PAUSE_S
    expected = [0.0, 0.08, 0.16, 0.24, pause_s, pause_s + 0.08, pause_s + 0.16]
    assert [one.capture_s for one in frames] == pytest.approx(expected)
    # Frames 1, 3, 5 and 7 of the first are left; its frame 2 is not.
    assert boxes == (box(2, 1), box(3, 1), box(6, 2))


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (clip("b", 5, size=(48, 32)), "b: .*48x32, a .*96x64"),
        (clip("b", 5, interval_s=0.14), r"a: .*10\.0 .*another clip 7\.1"),
        (clip("b", 1), "b: has fewer than two frames"),
        (clip("b", 5, interval_s=0.0), "b: .*time stamps"),
        (clip("b", 5, box(6, 1)), r"b: .*frame 6\b.*5"),
    ],
)
def test_clips_that_do_not_go_together(other: ConfirmedClip, told: str) -> None:
    with pytest.raises(LumpwatchError, match=told):
        joined_footage([clip("a", 5, box(1, 1)), other])


def test_a_clip_that_cannot_be_read_is_named() -> None:
    def broken() -> list[Frame]:
        raise LumpwatchError("cannot be read")

    with pytest.raises(TrainingError, match="b: cannot be read"):
        joined_footage([clip("a", 5), ConfirmedClip("b", (), broken)])


def test_false_alarms_alone_teach_nothing() -> None:
    roi = site(site_tree()).cameras[0].rois[0]
    with pytest.raises(TrainingError, match="labelled lump"):
        refine(roi, [clip("a", 5), clip("b", 5)])


# Learning from the pool


@dataclass(frozen=True)
class Feeds:
    """Two simulated clips with lumps, one without, and a camera for them."""

    videos: tuple[Path, Path]
    empty: Path
    tree: dict[str, Any]

    @property
    def camera(self) -> CameraConfig:
        return site(self.tree).cameras[0]

    def clip(self, k: int) -> ConfirmedClip:
        video = self.videos[k]
        return recorded_clip(self.camera, video.name, video, read_labels(video.with_suffix(".txt")))


@pytest.fixture(scope="module")
def feeds(tmp_path_factory: pytest.TempPathFactory) -> Feeds:
    videos, polygon = [], None
    for k, name in enumerate(("morning", "evening")):
        spec = FeedSpec(seed=3 + k, width=320, height=240, fps=15.0, lumps_per_minute=40)
        written = write_video(spec, 10.0, tmp_path_factory.mktemp(name))
        polygon = json.loads(written.spec.read_text())["polygon"]
        videos.append(written.video.rename(written.video.with_name(f"{name}.mp4")))
        written.labels.rename(videos[-1].with_suffix(".txt"))
    tree = site_tree()
    tree["cameras"][0]["rois"][0] |= {"polygon": polygon, "detector": SMALL}
    nothing = FeedSpec(seed=5, width=320, height=240, fps=15.0, lumps_per_minute=0)
    written = write_video(nothing, 2.0, tmp_path_factory.mktemp("empty"))
    return Feeds((videos[0], videos[1]), written.video.rename(written.video.with_name("empty.mp4")), tree)


@pytest.mark.slow
def test_one_clip_teaches_what_training_on_it_does(feeds: Feeds) -> None:
    roi, video = feeds.camera.rois[0], feeds.videos[0]
    frames, _ = read_frames(feeds.camera, video)
    once = train(roi, frames, read_labels(video.with_suffix(".txt")), Path("gt.txt"), video.name)
    again = refine(roi, [feeds.clip(0)])
    assert again.learned.tracks == once.learned.tracks
    assert np.array_equal(again.learned.label_counts, once.learned.label_counts)
    assert again.frames == once.frames
    for name in ("rates", "velocity_noise", "joint", "births"):
        # Time stamps are moved to begin at 0, which is rounding and nothing else.
        assert np.allclose(getattr(again.learned, name), getattr(once.learned, name), atol=1e-6), name


@pytest.mark.slow
def test_nothing_is_forgotten(feeds: Feeds) -> None:
    """The model of each step is given in the labels, so its counts add up exactly."""
    roi = feeds.camera.rois[0]
    one, other = (refine(roi, [feeds.clip(k)]).learned for k in (0, 1))
    both = refine(roi, [feeds.clip(0), feeds.clip(1)]).learned
    assert np.array_equal(both.label_counts, one.label_counts + other.label_counts)
    assert both.tracks == one.tracks + other.tracks
    low, high = (pick(one.profile.mean, other.profile.mean) for pick in (np.minimum, np.maximum))
    middle = both.profile.mean[:, 2:].mean()
    assert low[:, 2:].mean() - 0.05 <= middle <= high[:, 2:].mean() + 0.05


# The footage that is kept


def recording(folder: Path, name: str, size: int = 1000, labels: str = "1,1,0,0,5,5\n") -> tuple[Path, Path]:
    video, text = folder / f"{name}.mp4", folder / f"{name}.txt"
    video.write_bytes(name.encode() * size)
    text.write_text(labels)
    return video, text


def test_a_clip_is_kept_once_and_whole(tmp_path: Path) -> None:
    kept = FootageArchive(tmp_path / "var", *OF, most_bytes=1_000_000)
    assert kept.clips() == ()
    rng = np.random.default_rng(0)
    video, labels = recording(tmp_path, "a")
    assert kept.add(video, labels, rng) == ()
    assert kept.add(video, labels, rng) == ()
    (found,) = kept.clips()
    assert found.video.read_bytes() == video.read_bytes()
    assert found.labels.read_text() == labels.read_text()
    assert found.folder.name == kept.identity(video, labels)
    labels.write_text("1,1,0,0,6,6\n")  # labelled anew: another clip
    kept.add(video, labels, rng)
    kept.add(video, None, rng)
    assert len(kept.clips()) == 3
    # What a copy that died leaves behind is none.
    (kept.folder / ".half" / "x").mkdir(parents=True)
    (kept.folder / "odd").mkdir()
    assert len(kept.clips()) == 3


def test_pictures_in_a_folder_are_kept_as_well(tmp_path: Path) -> None:
    kept = FootageArchive(tmp_path / "var", *OF, most_bytes=1_000_000)
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "1.png").write_bytes(b"one")
    kept.add(tmp_path / "pictures", None, np.random.default_rng(0))
    (found,) = kept.clips()
    assert (found.video / "1.png").read_bytes() == b"one"
    assert (found.labels.read_bytes(), found.size) == (b"", 3)


def test_the_archive_is_bounded_and_old_clips_have_the_same_chance(tmp_path: Path) -> None:
    """Ten clips, room for some five: the newest stays, and over many draws the first does sometimes too."""
    survivors: list[list[str]] = []
    for seed in range(12):
        kept = FootageArchive(tmp_path / str(seed), *OF, most_bytes=5_500)
        rng = np.random.default_rng(seed)
        gone: list[str] = []
        for k in range(10):
            video, labels = recording(tmp_path, str(k))
            gone += kept.add(video, labels, rng)
            assert sum(one.size for one in kept.clips()) <= 5_500
            assert any(one.video.name == video.name for one in kept.clips())
        survivors.append([one.video.stem for one in kept.clips()])
        assert len(survivors[-1]) == 5
        assert sorted([*gone, *(f"{name}.mp4" for name in survivors[-1])]) == [f"{k}.mp4" for k in range(10)]
    assert any("0" in names for names in survivors)
    assert any("0" not in names for names in survivors)


@pytest.mark.parametrize("most", [0, 500])
def test_nothing_is_kept_where_that_is_not_wanted_or_does_not_fit(tmp_path: Path, most: int) -> None:
    kept = FootageArchive(tmp_path / "var", *OF, most_bytes=most)
    assert kept.add(*recording(tmp_path, "a"), np.random.default_rng(0)) == ()
    assert not (tmp_path / "var").exists()


def test_a_store_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "var").write_text("no folder")
    kept = FootageArchive(tmp_path / "var", *OF, most_bytes=10_000)
    with pytest.raises(StoreError, match="footage/cam/apron: cannot be written"):
        kept.add(*recording(tmp_path, "a"), np.random.default_rng(0))


# The command


@pytest.mark.slow
def test_train_then_refine_runs_in_shadow(
    feeds: Feeds, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = json.loads(json.dumps(feeds.tree))
    tree["cameras"][0]["rois"][0]["learning"] = {"footage_mb": 50}
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(tree))
    of = ("--camera", "cam", "--roi", "apron")
    morning, evening = (str(video) for video in feeds.videos)
    store = PriorStore(tmp_path / "var")

    labels = str(feeds.videos[0].with_suffix(".txt"))
    more = ("--without-lumps", str(feeds.empty), "--folds", "0")
    assert main(["train", str(config), morning, labels, *of, *more]) == 0
    capsys.readouterr()
    assert main(["refine", str(config), evening, *of]) == 0
    out, err = capsys.readouterr()
    assert "version 2 runs in shadow, learned from 3 clips" in out
    assert "it is neither given nor kept" not in err
    in_use, shadow = store.current(*OF).prior, store.shadow(*OF).prior
    assert in_use is not None
    assert shadow is not None
    assert (in_use.version, in_use.meta.source) == (1, "morning.mp4 + empty.mp4")
    assert (shadow.version, shadow.meta.source) == (2, "empty.mp4 + morning.mp4 + evening.mp4")
    kept = FootageArchive(tmp_path / "var", *OF, 1)
    assert {one.video.name for one in kept.clips()} == {"morning.mp4", "empty.mp4", "evening.mp4"}

    # The same clip once more is the same footage; without what was kept the loss is told.
    for one in kept.clips():
        if one.video.name == "morning.mp4":
            one.labels.unlink()
    assert main(["refine", str(config), evening, *of]) == 0
    out, err = capsys.readouterr()
    assert "learned from 2 clips" in out
    assert "morning.mp4: version 1 learned from it, and it is neither given nor kept" in err
    assert not same(store.shadow(*OF).prior, replace(shadow, version=3))

    assert main(["priors", "promote", str(config), *of]) == 0
    assert "version 3 is in use; back with priors rollback --version 1" in capsys.readouterr().out
    assert main(["priors", "list", str(config), *of]) == 0


def test_what_cannot_be_refined_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(site_tree()))
    of = ("--camera", "cam", "--roi", "apron")
    bare = tmp_path / "bare.mp4"
    bare.write_bytes(b"no video")
    for arguments, code, told in (
        ((str(bare),), 2, "has no labels beside it"),
        ((str(bare), "--unlabelled-is-empty"), 1, "no clip has a labelled lump"),
        ((str(bare), "--labels", str(tmp_path / "none.txt")), 1, "none.txt: cannot be read"),
    ):
        assert main(["refine", str(config), *arguments, *of]) == code
        err = capsys.readouterr().err
        assert told in err
        assert len(err.splitlines()) == 1
    assert PriorStore(tmp_path / "var").versions(*OF) == ()
