"""Labels as key frames: interpolation, MOTChallenge text, and back."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from lumpwatch.service.console.work import Labels, from_boxes, from_proposals, to_mot
from lumpwatch.service.console.work.tracks import Key, Track, thinned
from lumpwatch.service.storage import ignored_boxes, read_labels
from lumpwatch.service.training import to_text
from lumpwatch.service.training.label_proposals import Proposal, ProposedBox


def key(frame: int, x: float, y: float = 10, w: float = 20, h: float = 30) -> Key:
    return Key(frame=frame, x=x, y=y, w=w, h=h)


def test_between_two_key_frames_the_box_moves_and_grows_evenly() -> None:
    boxes = Track(id=1, keys=(key(3, 0), key(7, 8, 10, 40, 30))).boxes()
    assert [box.frame for box in boxes] == [3, 4, 5, 6, 7]
    assert [box.x for box in boxes] == [0, 2, 4, 6, 8]
    assert [box.w for box in boxes] == [20, 25, 30, 35, 40]


def test_the_text_is_what_training_reads(tmp_path: Path) -> None:
    track = Track(id=4, keys=(key(2, 0), key(4, 10)), ignored=(key(1, 0), key(2, 99)))
    path = tmp_path / "gt.txt"
    path.write_text(to_mot(Labels(tracks=(track,), proposals=(Track(id=9, keys=(key(1, 1),)),))))
    assert [(box.frame, box.track, box.x) for box in read_labels(path)] == [(2, 4, 0), (3, 4, 5), (4, 4, 10)]
    assert [box.frame for box in ignored_boxes(path)] == [1], "a frame is both labelled and ignored"


@given(st.lists(st.tuples(*[st.floats(0, 500)] * 2, *[st.floats(2, 100)] * 2), min_size=1, max_size=40))
def test_fewer_key_frames_say_the_same_within_a_pixel(boxes: list[tuple[float, float, float, float]]) -> None:
    keys = [Key(frame=i, x=x, y=y, w=w, h=h) for i, (x, y, w, h) in enumerate(boxes, start=1)]
    again = Track(id=1, keys=thinned(keys)).boxes()
    assert [box.frame for box in again] == [box.frame for box in keys]
    for box, was in zip(again, keys, strict=True):
        assert box.place == pytest.approx(was.place, abs=1.001)


def test_a_straight_way_needs_two_key_frames() -> None:
    assert len(thinned([key(frame, 2.0 * frame) for frame in range(1, 60)])) == 2


def test_proposals_of_the_filter_keep_what_is_to_be_ignored(tmp_path: Path) -> None:
    boxes = tuple(ProposedBox(frame, 2.0 * frame, 5, 20, 20, 0.6) for frame in range(3, 9))
    margin = (ProposedBox(2, 4, 5, 20, 20, 0.3),)
    (track,) = from_proposals(to_text([Proposal(7, boxes, margin)]))
    assert (track.id, track.existence, len(track.keys)) == (7, 0.6, 2)
    path = tmp_path / "gt.txt"
    path.write_text(to_mot(Labels(tracks=(track,))))
    assert [box.frame for box in read_labels(path)] == list(range(3, 9))
    assert [box.frame for box in ignored_boxes(path)] == [2]
    assert from_boxes(read_labels(path))[0].keys == track.keys


@pytest.mark.parametrize(
    "wrong",
    [
        {"tracks": [{"id": 1, "keys": []}]},
        {"tracks": [{"id": 1, "keys": [{"frame": 0, "x": 1, "y": 1, "w": 1, "h": 1}]}]},
        {"tracks": [{"id": 1, "keys": [{"frame": 1, "x": 1, "y": 1, "w": 0, "h": 1}]}]},
        {"tracks": [{"id": 1, "keys": [{"frame": 1, "x": float("nan"), "y": 1, "w": 1, "h": 1}]}]},
        {"tracks": [{"id": 1, "keys": [{"frame": n, "x": 1, "y": 1, "w": 1, "h": 1} for n in (2, 1)]}]},
        {"tracks": [{"id": 1, "keys": [{"frame": 1, "x": 1, "y": 1, "w": 1, "h": 1}]}] * 2},
        {"tracks": [{"id": 1, "keys": [{"frame": 1, "x": 1, "y": 1, "w": 1, "h": 1}]}], "empty": True},
        {"tracks": [], "more": 1},
    ],
)
def test_labels_that_contradict_themselves_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Labels.model_validate(wrong)
