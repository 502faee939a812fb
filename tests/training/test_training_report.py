"""Training from several small clips, with a report: what the page holds, and what is warned of."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.label_file import LabelError
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.training.coverage import coverage_warnings, relative_sizes, validation_warnings
from lumpwatch.service.training.cross_validation import Validation, cross_validate
from lumpwatch.service.training.dataset import Material, clips_of, gather
from lumpwatch.service.training.learner import learn
from lumpwatch.service.training.lump_cuts import cut_lumps
from tests.service_helpers import prior, site, site_tree

pytestmark = pytest.mark.slow

ODD = "a <b> & 'c'.mp4"
"""A name that would break a page that does not escape it."""


@dataclass(frozen=True)
class Site:
    """A configuration, two labelled clips and one without a lump."""

    folder: Path
    config: Path
    camera: CameraConfig
    pairs: tuple[tuple[Path, Path], ...]
    empty: Path

    def run(self, *arguments: object) -> int:
        words = ("train", self.config, *arguments, "--camera", "cam", "--roi", "apron")
        return main([str(word) for word in words])


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Site:
    folder = tmp_path_factory.mktemp("site")
    feed = partial(FeedSpec, width=240, height=180, lump_spacing_s=2.5)
    clips = []
    for name, spec in (
        (ODD, feed(seed=3, fps=10, lumps_per_minute=20)),
        ("slow.mp4", feed(seed=4, fps=5, lumps_per_minute=20)),
        ("empty.mp4", feed(seed=5, fps=10, lumps_per_minute=0)),
    ):
        written = write_video(spec, 18.0 if spec.lumps_per_minute else 3.0, folder / str(spec.seed))
        clips.append(written.video.rename(folder / name))
        written.labels.rename(folder / f"{spec.seed}.txt")
    tree = site_tree()
    polygon = json.loads((folder / "3" / "spec.json").read_text())["polygon"]
    # With a given share of evidence, training does not look for it.
    likelihood = {"kind": "lump", "evidence": 0.8}
    detector = {"working_size_px": 160, "particles": 1000, "likelihood": likelihood}
    tree["cameras"][0]["rois"][0] |= {"polygon": polygon, "detector": detector}
    config = folder / "site.yaml"
    config.write_text(json.dumps(tree))
    pairs = ((clips[0], folder / "3.txt"), (clips[1], folder / "4.txt"))
    return Site(folder, config, site(tree).cameras[0], pairs, clips[2])


@pytest.fixture(scope="module")
def material(small: Site) -> Material:
    clips = clips_of(small.pairs, [small.empty])
    return gather(small.camera, small.camera.rois[0], clips, lambda name, length: nullcontext(lambda n: None))


@pytest.fixture(scope="module")
def judged(small: Site, material: Material) -> tuple[Validation, list[int]]:
    """All lumps in three folds, and what was told of their progress."""
    done: list[int] = []
    found = cross_validate(small.camera.rois[0], material, 3, done.append)
    assert found is not None
    return found, done


class Page(HTMLParser):
    """Tags must close in order; text, tags and attributes are kept."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID and not self.get_starttag_text().endswith("/>"):  # type: ignore[union-attr]
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in self.VOID or (self.open and self.open[-1] != tag and tag in {"path", "polyline"}):
            return
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def attributes(self, name: str) -> list[str]:
        return [value or "" for _, given in self.seen for key, value in given.items() if key == name]


def test_several_clips_and_a_report(small: Site, capsys: pytest.CaptureFixture[str]) -> None:
    report = small.folder / "report.html"
    pairs = [path for pair in small.pairs for path in pair]
    assert small.run(*pairs, "--without-lumps", small.empty, "--report", report, "--folds", 3) == 0
    told = capsys.readouterr()
    assert re.search(r"Held out: \d+ of \d+ lumps would be found", told.out)
    store = PriorStore(small.folder / "var")
    stored = store.current("cam", "apron").prior
    assert stored is not None
    assert stored.meta.source == f"{ODD} + slow.mp4 + empty.mp4"
    assert stored.meta.frames == 180 + 90 + 30
    text = report.read_text(encoding="utf-8")
    assert store.report_path("cam", "apron", stored.version).read_text(encoding="utf-8") == text
    assert store.lumps("cam", "apron", stored.version)
    page = Page(text)
    assert f"{ODD}" in page.text  # as text, not as a tag
    assert "<b>" not in text
    assert not {tag for tag, _ in page.seen} & {"script", "link", "iframe", "object"}
    pictures = page.attributes("src")
    assert len(pictures) >= 5
    assert all(picture.startswith("data:image/") for picture in pictures)
    assert page.attributes("href") == []
    assert "://" not in re.sub(r'src="data:[^"]*"', "", text)
    for heading in (
        "Warnings",
        "Each lump, judged by what the others teach",
        "Hardest moments",
        "Clips, the hardest",
    ):
        assert heading in page.text
    assert "larger than" in page.text  # a measure of the net's maps, in words
    assert "How much of a frame counts is configured" in page.text
    assert sum(tag == "svg" for tag, _ in page.seen) >= 10
    for warning in told.err.splitlines():
        assert warning.removeprefix("lumpwatch: warning: ") in page.text


def test_a_clip_with_few_labels_is_warned_of(small: Site, capsys: pytest.CaptureFixture[str]) -> None:
    video, labels = small.pairs[1]
    few = small.folder / "few.txt"
    few.write_text(
        "".join(f"{line}\n" for line in labels.read_text().splitlines() if line.split(",")[1] == "1")
    )
    assert small.run(video, few) == 0
    told = capsys.readouterr()
    assert "lumpwatch: warning: only 1 labelled objects: eight and more" in told.err
    store = PriorStore(small.folder / "var")
    newest = store.versions("cam", "apron")[-1]
    page = Page(store.report_path("cam", "apron", newest).read_text(encoding="utf-8"))
    assert "only 1 labelled objects" in page.text
    assert "Not done: it takes a jdt detector, two labelled lumps" in page.text


def test_a_training_that_finds_none_of_its_own_lumps_is_not_used(
    small: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An alarm that asks for more existence than there ever is finds nothing."""
    tree = json.loads(small.config.read_text()) | {"store": {"path": str(tmp_path / "var")}}
    tree["cameras"][0]["rois"][0]["alarm"] |= {"raise_above": 1.0}
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(tree))
    strict, store = replace(small, config=config), PriorStore(tmp_path / "var")
    assert strict.run(*small.pairs[1], "--folds", 2) == 1
    assert "version 1 is stored and not in use: none of" in capsys.readouterr().err
    assert store.current("cam", "apron").prior is None
    assert store.untried("cam", "apron", 1)
    assert store.report_path("cam", "apron", 1).is_file()
    assert strict.run(*small.pairs[1], "--folds", 2, "--use-anyway") == 0
    assert store.pointer("cam", "apron") == 2


def test_suggest_refuse_accept_train(small: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """From a clip to a prior by way of proposals; proposals are taken as labels only once accepted."""
    assert small.run(*small.pairs[1], "--folds", 0) == 0
    video = small.pairs[0][0]
    capsys.readouterr()
    out = small.folder / "proposed.txt"
    assert small.run(video, "--suggest", out) == 0
    count = int(capsys.readouterr().out.split()[0])
    assert count >= 2
    sheet = Page(out.with_suffix(".html").read_text())
    assert sheet.attributes("alt") == [f"proposal {number}" for number in range(1, count + 1)]
    assert f"Proposals for {ODD}" in sheet.text
    assert small.run(video, "--suggest", out) == 2
    assert "exists; proposals do not overwrite labels" in capsys.readouterr().err
    assert small.run(video, out) == 1
    assert re.search(r"proposed\.txt, line \d+: lump 1 is a proposal that nobody", capsys.readouterr().err)
    assert small.run(video, out, "--accept", "99") == 1
    assert "has no proposal 99" in capsys.readouterr().err
    assert small.run(video, out, "--accept", "all", "--folds", 0) == 0
    assert f"{count} accepted" in capsys.readouterr().out
    stored = PriorStore(small.folder / "var").current("cam", "apron").prior
    assert stored is not None
    assert stored.learned.tracks == count


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("{video}",), "LABELS is needed to train"),
        (("{video}", "{labels}", "{empty}"), r"empty\.mp4: has no LABELS"),
        (("{video}", "{labels}", "{video}", "{labels}"), "is given more than once"),
        (("{video}", "{labels}", "--suggest", "x.txt"), "--suggest takes one VIDEO, without LABELS"),
        (("{video}", "--suggest", "x.html"), "is a label file; its pictures"),
        (
            ("{video}", "{labels}", "{empty}", "{labels}", "--accept", "1"),
            "--accept works on one VIDEO LABELS",
        ),
        (("{video}", "{labels}", "--folds", "1"), "--folds 1: "),
        (
            ("{video}", "{labels}", "--report", "no/such/r.html"),
            "--report no/such/r.html: ",
        ),
    ],
)
def test_arguments_that_do_not_go_together(
    small: Site, words: tuple[str, ...], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    video, labels = small.pairs[0]
    filled = [word.format(video=video, labels=labels, empty=small.empty) for word in words]
    assert small.run(*filled) == 2
    told = capsys.readouterr().err
    assert re.search(reason, told)
    assert len(told.splitlines()) == 1


# Clips together


def test_clips_of_two_frame_rates_become_one(material: Material) -> None:
    footage = material.footage
    assert footage.interval_s == pytest.approx(0.2)  # the slower
    assert footage.count == 300
    assert {moment.clip for moment in footage.moments} == {0, 1, 2}
    assert len(footage.moments) == len(footage.views)
    for view, moment in zip(footage.views, footage.moments, strict=True):
        assert len(view.objects) == len(moment.tracks)
    speeds = [
        float(np.median(np.diff(track.boxes[:, 1]))) / 0.2
        for clip in (0, 1)
        for lump in material.lumps
        if lump.clip == clip
        for track in lump.tracks
        if len(track.frames) > 35
    ]
    assert len(speeds) >= 5
    assert max(speeds) < 1.5 * min(speeds)  # a belt of one speed, seen at 10 and at 5 frames a second


def test_frames_to_be_ignored_teach_nothing(small: Site, tmp_path: Path) -> None:
    video, labels = small.pairs[0]
    changed = tmp_path / "ignored.txt"
    changed.write_text(labels.read_text() + "".join(f"{f},99,80,60,20,20,0,1,1\n" for f in range(1, 21)))
    (clip,) = clips_of([(video, changed)], [])
    found = gather(
        small.camera, small.camera.rois[0], (clip,), lambda name, length: nullcontext(lambda n: None)
    )
    assert min(moment.frame for moment in found.footage.moments) == 21


def test_clips_that_do_not_fit_together(small: Site, tmp_path: Path) -> None:
    other = write_video(FeedSpec(seed=1, width=320, height=180), 1.0, tmp_path)
    clips = clips_of(small.pairs[:1], [other.video])
    with pytest.raises(LumpwatchError, match=r"video\.mp4: .*320 x 180.* 240 x 180"):
        gather(small.camera, small.camera.rois[0], clips, lambda name, length: nullcontext(lambda n: None))
    labels = tmp_path / "late.txt"
    labels.write_text("999,1,80,60,20,20,1,1,1\n")
    with pytest.raises(LabelError, match=r"late\.txt: .*frame 999\b.*slow\.mp4 .*90"):
        gather(
            small.camera,
            small.camera.rois[0],
            clips_of([(small.pairs[1][0], labels)], []),
            lambda name, length: nullcontext(lambda n: None),
        )


# Cross-validation


def test_every_lump_is_judged_without_itself(
    material: Material, judged: tuple[Validation, list[int]]
) -> None:
    found, done = judged
    assert done == [1, 2, 3]
    assert found.folds == 3
    lumps = {(one.lump.clip, one.lump.id) for one in found.lumps}
    assert len(lumps) + len(found.failures) == len(found.lumps) + len(found.failures) == len(material.lumps)
    long = [one for one in found.lumps if one.lump.clip == 0 and len(one.judged) >= 50]
    assert len(long) == 4
    assert all(one.won > 0.5 for one in long)
    assert sum(one.warned_s is not None for one in long) >= 3
    assert found.hardest[0].margin <= np.median([one.margin for one in found.lumps])
    for one in found.lumps:
        assert all(one.lump.id in material.footage.moments[k.view].tracks for k in one.judged)
        assert one.hardest.margin == min(k.margin for k in one.judged)
        assert one.warned_s is None or one.warned_s >= 0
    check_cuts(material, found)


def check_cuts(material: Material, found: Validation) -> None:
    """What proof tests show: the hardest first, each as it lies in a picture, with a fifth of its sides around it."""
    cuts = cut_lumps(material, found, most=3)
    assert len(cuts) == 3
    assert "the hardest" in cuts[0].name
    for cut in cuts:
        x, y, w, h = (side * material.footage.roi.shape[0] for side in cut.box)
        left, top = round(x - 0.7 * w), round(y - 0.7 * h)
        rows, columns = cut.picture.shape
        assert (columns, rows) == pytest.approx((1.4 * w, 1.4 * h), abs=1.0)
        pictures = (view.view.gray for view in material.footage.views)
        assert any(
            np.array_equal(one[top : top + rows, left : left + columns], cut.picture) for one in pictures
        )
    assert not any("hardest" in cut.name for cut in cut_lumps(material, None))


def test_a_held_out_lump_is_found_when_the_alarm_stands(small: Site, material: Material) -> None:
    """Not at the first picture on which the filter believes in it: the alarm waits for its on-delay."""
    roi = small.camera.rois[0]
    patient = roi.model_copy(update={"alarm": roi.alarm.model_copy(update={"on_delay_s": 60.0})})
    found = cross_validate(patient, replace(material, lumps=material.lumps[:2]), 2)
    assert found is not None
    assert found.lumps
    assert not found.found
    assert {one.warned_s for one in found.lumps} == {None}


def test_a_fold_shows_no_picture_of_its_lumps(material: Material) -> None:
    lump = material.lumps[0]
    rest = material.without([lump], 1000)
    assert lump not in rest.lumps
    assert not any(lump.clip == m.clip and lump.id in m.tracks for m in rest.footage.moments)
    shown = sum(lump.clip == m.clip and lump.id in m.tracks for m in material.footage.moments)
    assert len(rest.footage.views) == len(material.footage.views) - shown
    assert 0 < len(material.without([lump], 40).footage.views) <= 40


def test_one_lump_cannot_be_cross_validated(small: Site, material: Material) -> None:
    one = replace(material, lumps=material.lumps[:1])
    assert cross_validate(small.camera.rois[0], one, 5) is None
    assert cross_validate(small.camera.rois[0], material, 0) is None


# Warnings


def test_what_the_labels_do_not_cover(small: Site, material: Material) -> None:
    learned = learn(small.camera.rois[0], material.footage, material.tracks, "gt.txt").learned
    assert not any("labels lie in" in warning for warning in coverage_warnings(material, learned))
    height = material.footage.roi.shape[0]
    views = [
        replace(view, objects=view.objects[view.objects[:, 1] < 0.3 * height])
        for view in material.footage.views
    ]
    top = replace(material, footage=replace(material.footage, views=views), outside=((1, 7), (0, 8)))
    told = coverage_warnings(top, learned)
    assert any(
        re.match(r"labels lie in \d+% to \d+% of the region's (height|width) only: ", one) for one in told
    )
    assert any(one.startswith("lump 7 of slow.mp4 and 1 more: labelled outside the ROI") for one in told)
    short = replace(
        material,
        lumps=tuple(
            replace(
                lump, tracks=tuple(replace(t, frames=t.frames[:3], boxes=t.boxes[:3]) for t in lump.tracks)
            )
            for lump in material.lumps
        ),
    )
    assert any("labelled for less than 1 s" in one for one in coverage_warnings(short, learned))


def test_lumps_of_one_size_are_warned_of(material: Material) -> None:
    """A prior whose lumps are a quarter of the region large, and lumps that all are."""
    known = prior().learned
    size = 0.25 * material.footage.roi.shape[0]

    def sized(*factors: float) -> Material:
        lumps = []
        for lump, factor in zip(material.lumps, factors, strict=False):
            (first, *_) = lump.tracks
            boxes = first.boxes.copy()
            boxes[:, 2:] = factor * size
            lumps.append(replace(lump, tracks=(replace(first, boxes=boxes),)))
        return replace(material, lumps=tuple(lumps))

    assert relative_sizes(sized(1.0, 1.5), known) == pytest.approx([1.0, 1.5])
    alike = coverage_warnings(sized(1.0, 1.05, 1.1), known)
    assert any("all lumps are of nearly the same size for their row (1.00 to 1.10" in one for one in alike)
    assert not any("nearly the same size" in one for one in coverage_warnings(sized(0.8, 1.0, 1.3), known))


def test_missed_lumps_are_named(material: Material, judged: tuple[Validation, list[int]]) -> None:
    found, _ = judged
    never = tuple(replace(one, lump=replace(one.lump, cut_off=False), warned_s=None) for one in found.lumps)
    *_, told = validation_warnings(replace(found, lumps=never), material)
    assert told.startswith(
        f"{len(never)} of {len(never)} lumps would not be found by what the others teach (1 of a"
    )
    cut = tuple(replace(one, lump=replace(one.lump, cut_off=True), warned_s=None) for one in found.lumps)
    assert validation_warnings(replace(found, lumps=cut, failures=()), material) == ()
    told = validation_warnings(replace(found, lumps=cut, failures=("too little",)), material)[0]
    assert told == "cross-validation: too little: label more lumps"
