"""Refining: learning from a pool of confirmed clips, the footage that is kept for it, and the command."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.evaluation import overlaps
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli import main
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.footage_archive import FootageArchive
from lumpwatch.service.storage.label_file import read_labels
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.versions import StoreError
from lumpwatch.service.training import (
    Material,
    Trained,
    confirmed_clips,
    gather,
    learn,
    tempered,
    unboxed,
)
from lumpwatch.service.training.learner import train
from tests.service_helpers import same, site, site_tree

OF = ("cam", "apron")
SMALL = {"working_size_px": 160, "likelihood": {"kind": "lump", "evidence": 0.8}}
"""With a given share of evidence, training does not look for it."""
CHEAP = SMALL | {"likelihood": {"kind": "histogram", "evidence": 0.5}, "particles": 50}
"""For what is learned of motion and places, whatever the likelihood, and for the command's ways."""


# Learning from the pool


@dataclass(frozen=True)
class Feeds:
    """Two simulated clips with lumps, one without, and a camera for them."""

    videos: tuple[Path, Path]
    empty: Path
    tree: dict[str, Any]
    learned: dict[tuple[int, ...], tuple[Material, Trained]] = field(default_factory=dict)

    @property
    def camera(self) -> CameraConfig:
        return site(self.tree).cameras[0]

    @property
    def cheap(self) -> RoiConfig:
        """Its region with a likelihood that is learned in a moment."""
        tree = json.loads(json.dumps(self.tree))
        tree["cameras"][0]["rois"][0]["detector"] = CHEAP
        return site(tree).cameras[0].rois[0]

    def learn(self, *chosen: int) -> tuple[Material, Trained]:
        """From those of the clips with lumps, as the command does, with the cheap likelihood; once for all tests."""
        if chosen in self.learned:
            return self.learned[chosen]
        self.learned[chosen] = self.learn_with(self.cheap, *chosen)
        return self.learned[chosen]

    def learn_with(self, roi: RoiConfig, *chosen: int) -> tuple[Material, Trained]:
        found = [(self.videos[k], self.videos[k].with_suffix(".txt")) for k in chosen]
        material = gather(self.camera, roi, confirmed_clips(found), lambda *_: nullcontext(lambda _: None))
        trained = learn(roi, material.footage, material.tracks, "the clips")
        return material, tempered(roi, material.footage, trained)


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
    roi, video = feeds.cheap, feeds.videos[0]
    frames, _ = read_frames(feeds.camera, video)
    once = train(roi, frames, read_labels(video.with_suffix(".txt")), Path("gt.txt"), video.name)
    _, again = feeds.learn(0)
    assert again.learned.tracks == once.learned.tracks
    assert np.array_equal(again.learned.label_counts, once.learned.label_counts)
    assert again.frames == once.frames
    for name in ("rates", "velocity_noise", "joint", "births"):
        assert np.allclose(getattr(again.learned, name), getattr(once.learned, name), atol=1e-6), name


@pytest.mark.slow
def test_nothing_is_forgotten(feeds: Feeds) -> None:
    """The model of each step is given in the labels, so its counts add up exactly."""
    one, other, both = (feeds.learn(*chosen)[1].learned for chosen in ((0,), (1,), (0, 1)))
    assert np.array_equal(both.label_counts, one.label_counts + other.label_counts)
    assert both.tracks == one.tracks + other.tracks
    low, high = (pick(one.profile.mean, other.profile.mean) for pick in (np.minimum, np.maximum))
    middle = both.profile.mean[:, 2:].mean()
    assert low[:, 2:].mean() - 0.05 <= middle <= high[:, 2:].mean() + 0.05


@pytest.mark.slow
def test_a_lump_that_nobody_boxed_is_told(feeds: Feeds, tmp_path: Path) -> None:
    roi = feeds.camera.rois[0]
    material, trained = feeds.learn_with(roi, 0)
    assert unboxed(roi, material, trained.learned, [0]) == ()
    assert unboxed(roi, material, trained.learned, []) == ()
    longest = max(material.lumps, key=lambda lump: sum(len(track.frames) for track in lump.tracks))
    rows = feeds.videos[0].with_suffix(".txt").read_text().splitlines(keepends=True)
    kept = tmp_path / "some.txt"
    kept.write_text("".join(row for row in rows if row.split(",")[1] != str(longest.id)))
    clips = confirmed_clips([(feeds.videos[0], kept)])
    some = gather(feeds.camera, roi, clips, lambda *_: nullcontext(lambda _: None))
    (found,) = unboxed(roi, some, trained.learned, [0])
    assert found.lasts_s >= 0.5
    boxes = [row.split(",") for row in rows if row.split(",")[1] == str(longest.id)]
    x, y, w, h = next(map(float, row[2:6]) for row in boxes if int(row[0]) == found.first_frame)
    assert overlaps(np.array([found.box]), np.array([[x, y, w, h]]))[0, 0] > 0.3
    assert f"morning.mp4: from frame {found.first_frame} on" in found.words(some)


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
    # What refining does is the same for either likelihood.
    tree["cameras"][0]["rois"][0] |= {"learning": {"footage_mb": 50}, "detector": CHEAP}
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(tree))
    of = ("--camera", "cam", "--roi", "apron")
    morning, evening = (str(video) for video in feeds.videos)
    store = PriorStore(tmp_path / "var")

    labels = str(feeds.videos[0].with_suffix(".txt"))
    more = ("--without-lumps", str(feeds.empty), "--folds", "0")
    assert main(["train", str(config), morning, labels, *of, *more]) == 0
    capsys.readouterr()
    assert main(["refine", str(config), evening, *of, "--folds", "2"]) == 0
    out, err = capsys.readouterr()
    assert "version 2 runs in shadow, learned from 3 clips" in out
    assert "it is neither given nor kept" not in err
    assert "Held out: " in out
    assert store.report_path(*OF, 2).read_text().count("evening.mp4") > 0
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
    assert main(["refine", str(config), evening, *of, "--folds", "0", "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert (told["version"], told["clips"], told["objection"]) == (3, 2, None)
    assert told["report"] == str(store.report_path(*OF, 3))
    assert any("neither given nor kept" in warning for warning in told["warnings"])
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
