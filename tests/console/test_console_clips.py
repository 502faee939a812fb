"""Clips: frames by number, what is taken in, and what is not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lumpwatch.service.capture import read_frames
from lumpwatch.service.console.work import ClipError, LabelConflictError, Labels, Library, VideoError
from lumpwatch.service.console.work.tracks import Key, Track
from lumpwatch.service.console.work.video_frames import VideoFrames
from lumpwatch.service.core import VideoWriter
from tests.service_helpers import site, site_tree

FRAMES = 150


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Each frame has its number as its brightness; key frames are 50 apart."""
    path = tmp_path_factory.mktemp("video") / "clip.mp4"
    with VideoWriter(path, 64, 48, 10, gop=50) as writer:
        for number in range(FRAMES):
            writer.write(np.full((48, 64), 50 + number, np.uint8))
    return path


def brightness(jpeg: bytes) -> float:
    return float(np.mean(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)))  # type: ignore[arg-type]


def test_frames_come_by_the_number_that_training_gives_them(video: Path) -> None:
    frames, _ = read_frames(site(site_tree()).cameras[0], video)
    means = [float(frame.data.mean()) for frame in frames]
    with VideoFrames(video, "clip") as opened:
        assert (opened.facts.frames, opened.facts.width) == (FRAMES, 64)
        assert opened.facts.fps == pytest.approx(10)
        for number in (1, 2, 3, 120, 119, 60, 150, 1, 148, 149):
            assert brightness(opened.jpeg(number)) == pytest.approx(means[number - 1], abs=1.5), number
        for number in (0, -1, FRAMES + 1):
            with pytest.raises(KeyError):
                opened.jpeg(number)


def taken(library: Library, video: Path, name: str = "clip.mp4") -> str:
    with library.arriving(name) as path:
        path.write_bytes(video.read_bytes())
        return library.take(path, name, "cam", "file", "emma").id


def test_what_is_no_video_leaves_nothing_behind(tmp_path: Path, video: Path) -> None:
    library = Library(tmp_path / "clips", 1 << 20)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(video.read_bytes()[:-2000])
    text = tmp_path / "text.mp4"
    text.write_text("<script>alert(1)</script>")
    for wrong in (cut, text):
        with pytest.raises(VideoError, match="wrong"):
            taken(library, wrong, "wrong.mp4")
    with pytest.raises(ClipError, match="is none of"):
        taken(library, video, "page.html")
    assert library.clips() == []
    assert list((tmp_path / "clips").iterdir()) == []


def test_names_of_files_become_neither_paths_nor_commands(tmp_path: Path, video: Path) -> None:
    library = Library(tmp_path / "clips", 1 << 20)
    clip = taken(library, video, "../--accept <b>.mp4")
    assert library.video(clip).name == "accept-b.mp4"
    for wrong in ("..", "../../etc", "", "20260101T000000-zzzzzz", "20260101T000000-000000"):
        with pytest.raises(KeyError):
            library.about(wrong)


def test_labels_of_two_people_are_not_overwritten(tmp_path: Path, video: Path) -> None:
    library = Library(tmp_path / "clips", 1 << 20)
    clip = taken(library, video)
    box = Key(frame=FRAMES, x=1, y=1, w=5, h=5)
    first = library.label(clip, Labels(tracks=(Track(id=1, keys=(box,)),)), 0, "emma")
    assert first.revision == 1
    with pytest.raises(LabelConflictError, match="emma"):
        library.label(clip, Labels(empty=True), 0, "otto")
    library.propose(clip, (Track(id=1, keys=(box,), existence=0.7),))
    kept = library.labels(clip)
    assert [track.id for track in kept.labels.proposals] == [2], "a proposal has the number of a lump"
    assert kept.labels.tracks == first.labels.tracks
    late = Labels(tracks=(Track(id=1, keys=(box.model_copy(update={"frame": FRAMES + 1}),)),))
    with pytest.raises(ClipError, match="150 frames"):
        library.label(clip, late, 2, "emma")
    library.remove(clip)
    assert library.clips() == []


def test_a_full_library_takes_no_more(tmp_path: Path, video: Path) -> None:
    library = Library(tmp_path / "clips", video.stat().st_size)
    taken(library, video)
    with pytest.raises(ClipError, match="work_mb"):
        taken(library, video)
