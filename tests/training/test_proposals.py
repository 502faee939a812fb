"""Proposals: what is proposed, the file, and how a person turns proposals into labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lumpwatch.service.cli.train import _without_proposals
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.storage.label_file import LabelError, ignored_frames, is_proposal, read_labels
from lumpwatch.service.training.label_proposals import (
    Proposal,
    ProposedBox,
    accept_proposals,
    parse_ids,
    to_text,
)
from lumpwatch.service.training.proposing import AFTER_S, BEFORE_S, Surest, suggest
from tests.service_helpers import HEIGHT, INTERVAL_S, WIDTH, camera, frame, prior


def proposal(number: int, first: int, existence: float = 0.8) -> Proposal:
    boxes = tuple(ProposedBox(f, 10.0 + f, 20.0, 30.0, 40.0, existence) for f in range(first, first + 3))
    before = ProposedBox(first - 1, 9.0 + first, 20.0, 30.0, 40.0, 0.0)
    return Proposal(number, boxes, (before,))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "new.txt"
    path.write_text(to_text([proposal(1, 5), proposal(2, 20, 1.0), proposal(3, 40, 0.0001)]))
    return path


def test_the_file_holds_existence_as_conf_and_no_class(file: Path) -> None:
    lines = file.read_text().splitlines()
    assert lines[0].startswith("# frame,id,x,y,w,h,conf,class,visibility")
    assert lines[1] == "4,1,14.00,20.00,30.00,40.00,0,-1,-1"
    assert lines[2] == "5,1,15.00,20.00,30.00,40.00,0.8,-1,-1"
    assert lines[6] == "20,2,30.00,20.00,30.00,40.00,0.999,-1,-1"  # never 1: that would be a label
    assert lines[10] == "40,3,50.00,20.00,30.00,40.00,0.001,-1,-1"  # never 0: that would be ignored
    assert sum(map(is_proposal, lines)) == 9


@pytest.mark.parametrize(
    ("line", "is_one"),
    [
        ("5,1,1,1,2,2,0.8,-1,-1", True),
        (" 5, 1, 1, 1, 2, 2, 0.8, -1.0, -1", True),
        ("5,1,1,1,2,2,1,-1,-1", False),
        ("5,1,1,1,2,2,0,-1,-1", False),
        ("5,1,1,1,2,2,0.8,1,1", False),
        ("5,1,1,1,2,2,0.8", False),
        ("# 5,1,1,1,2,2,0.8,-1,-1", False),
    ],
)
def test_what_a_proposal_is(line: str, *, is_one: bool) -> None:
    assert is_proposal(line) is is_one


def test_a_proposal_is_no_label(file: Path) -> None:
    with pytest.raises(LabelError) as caught:
        read_labels(file)
    assert str(caught.value).startswith(f"{file}, line 3: lump 1 ")
    assert "--accept 1 " in str(caught.value)


def test_accepted_ones_are_labels_and_the_rest_is_background(file: Path) -> None:
    assert accept_proposals(file, {1, 3}) == 2
    boxes = read_labels(file)
    assert [(box.track, box.frame) for box in boxes] == [(1, 5), (1, 6), (1, 7), (3, 40), (3, 41), (3, 42)]
    assert boxes[0].x == 15.0
    assert boxes[0].model is None
    assert ignored_frames(file) == {4, 39}  # around the rejected one nothing is left out
    assert file.read_text().count("# rejected: ") == 4


def test_all_are_accepted(file: Path) -> None:
    assert accept_proposals(file, None) == 3
    assert {box.track for box in read_labels(file)} == {1, 2, 3}


def test_a_person_may_edit_the_file(file: Path) -> None:
    """conf 1 accepts by hand; other labels in the file stay as they are."""
    text = file.read_text().replace(",0.8,-1,-1", ",1,-1,-1")
    file.write_text(text + "90,9,1,2,3,4,1,1,1,belt\n")
    assert accept_proposals(file, {2}) == 1
    assert {box.track for box in read_labels(file)} == {1, 2, 9}
    assert "90,9,1,2,3,4,1,1,1,belt" in file.read_text().splitlines()


def test_what_cannot_be_accepted(file: Path, tmp_path: Path) -> None:
    before = file.read_bytes()
    with pytest.raises(LabelError, match=r"new\.txt: .*proposal 7 .*1, 2, 3"):
        accept_proposals(file, {1, 7})
    assert file.read_bytes() == before
    accept_proposals(file, None)
    with pytest.raises(LabelError, match="no proposal"):
        accept_proposals(file, None)
    with pytest.raises(LabelError, match="cannot be read"):
        accept_proposals(tmp_path / "none.txt", None)


def test_ids_of_the_command() -> None:
    assert parse_ids("all") is None
    assert parse_ids("3, 1") == frozenset({1, 3})
    for wrong in ("", "1,,2", "one"):
        with pytest.raises(ConfigError, match="expected all, or ids"):
            parse_ids(wrong)


# Proposing


def shown(k: int) -> Frame:
    """A square that rides down from frame 20 to 59, hidden in frames 35 to 41."""
    data = np.full((HEIGHT, WIDTH), 20, np.uint8)
    if 20 <= k < 60 and not 35 <= k < 42:
        top = 14 + (k - 20) // 2
        data[top : top + 12, 40:52] = 250
    return frame(k, data=data)


@pytest.fixture(scope="module")
def watching() -> CameraConfig:
    return camera(existence={"birth_rate_hz": 0.5, "mean_life_s": 2.0})


def test_a_lump_that_was_lost_for_a_while_is_one_proposal(watching: CameraConfig) -> None:
    told: list[int] = []
    (one,) = suggest(watching, prior(), map(shown, range(90)), told.append)
    assert told == list(range(1, 91))
    boxes = one.proposal.boxes
    frames = [box.frame for box in boxes]
    assert frames == list(range(frames[0], frames[-1] + 1))
    assert 20 < frames[0] < 32
    assert 55 < frames[-1] < 70
    by_frame = {box.frame: box for box in boxes}
    assert by_frame[50].x + by_frame[50].w / 2 == pytest.approx(46, abs=4)
    assert by_frame[50].y + by_frame[50].h / 2 == pytest.approx(14 + 29 // 2 + 6, abs=4)
    assert 0.9 < one.proposal.existence <= 1.0
    assert (one.first_s, one.last_s) == pytest.approx(
        ((frames[0] - 1) * INTERVAL_S, (frames[-1] - 1) * INTERVAL_S)
    )
    margin = [box.frame for box in one.proposal.margin]
    assert min(margin) >= frames[0] - BEFORE_S / INTERVAL_S
    assert max(margin, default=0) <= frames[-1] + AFTER_S / INTERVAL_S
    assert not set(margin) & set(frames)
    assert one.picture.ndim == 3
    assert one.picture.max() > 200


def test_nothing_is_proposed_where_nothing_is(watching: CameraConfig) -> None:
    assert suggest(watching, prior(), [frame(k) for k in range(40)]) == []


def test_a_video_without_frames(watching: CameraConfig) -> None:
    with pytest.raises(LumpwatchError, match="fewer than two frames"):
        suggest(watching, prior(), [frame(0)])


def test_without_a_proposal_it_is_said_where_existence_was_highest_and_how_to_go_on() -> None:
    told = _without_proposals(Surest(0.31, 42, 2.8, (10, 20, 30, 40)), Path("gt.txt"))
    assert "highest existence was 0.310 in frame 42, 2.8 s, box 10 20 30 40" in told
    assert "margin lower" in told
    assert "gt.txt is frame,id,x,y,w,h" in told
    assert "lumpwatch reference" in _without_proposals(Surest(), Path("gt.txt"))
