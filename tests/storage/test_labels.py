"""MOTChallenge labels: what is read, and what each bad line is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lumpwatch.service.storage.label_file import Box, LabelError, check_frames, read_labels


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "gt.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_good_file(tmp_path: Path) -> None:
    text = (
        "# frame,id,x,y,w,h,conf,class,visibility,model\n"
        "\n"
        "2,7,10.5,20,30,40,1,1,0.9,fall\r\n"
        "  \n"
        "1,7,10,20,30,40.25,1,1,1,belt\n"
        " 1 , 3 , 0 , -4 , 5 , 6 \n"
        "5,3,1,1,2,2,0,1,1,belt\n"
        "6,3,1,1,2,2,,,,\n"
        "7,3,1,1,2,2,0.4,1,1,"
    )
    assert read_labels(write(tmp_path, text)) == (
        Box(1, 3, 0.0, -4.0, 5.0, 6.0, None),
        Box(6, 3, 1.0, 1.0, 2.0, 2.0, None),
        Box(7, 3, 1.0, 1.0, 2.0, 2.0, None),
        Box(1, 7, 10.0, 20.0, 30.0, 40.25, "belt"),
        Box(2, 7, 10.5, 20.0, 30.0, 40.0, "fall"),
    )


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("1,1,2,3,4", "found 5 fields"),
        ("frame,id,x,y,w,h", "'frame,id,x,y,w,h' "),
        ("1,1,2,3,4,5,high", "not a number"),
        ("1.5,1,2,3,4,5", "frame and id must be whole"),
        ("1,1.5,2,3,4,5", "frame and id must be whole"),
        ("1,1,nan,3,4,5", "all numbers finite"),
        ("inf,1,2,3,4,5", "all numbers finite"),
        ("0,1,2,3,4,5", "frames count from 1, found 0"),
        ("-3,1,2,3,4,5", "frames count from 1, found -3"),
        ("1,1,2,3,0,5", "width and height must be positive"),
        ("1,1,2,3,4,-5", "width and height must be positive"),
        ("9,1,2,3,4,5,1,1,1,belt", "track 1 "),
        ("1e300,1,2,3,4,5", "beyond 1e+09"),
        ("1,1e300,2,3,4,5", "beyond 1e+09"),
        ("1,1,1e308,3,1e308,5", "beyond 1e+09"),
        ("1,1,2,3,4,5,nan", "all numbers finite"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, line: str, reason: str) -> None:
    path = write(tmp_path, f"9,1,2,3,4,5\n# note\n{line}\n")
    with pytest.raises(LabelError) as caught:
        read_labels(path)
    told = str(caught.value)
    assert told.startswith(f"{path}, line 3: ")
    assert reason in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "1,1,2,3,4,5,0\n"])
def test_a_file_without_a_box(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(LabelError, match=r"gt\.txt: .*no labelled box"):
        read_labels(path)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(LabelError, match=r"none\.txt: cannot be read"):
        read_labels(tmp_path / "none.txt")


def test_a_folder(tmp_path: Path) -> None:
    with pytest.raises(LabelError, match=r"cannot be read"):
        read_labels(tmp_path)


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    with pytest.raises(LabelError, match=r"gt\.txt: is not text$"):
        read_labels(write(tmp_path, b"1,1,\xff\xfe,3,4,5\n"))


def test_a_file_with_a_byte_order_mark(tmp_path: Path) -> None:
    assert read_labels(write(tmp_path, b"\xef\xbb\xbf1,1,2,3,4,5\n")) == (
        Box(1, 1, 2.0, 3.0, 4.0, 5.0, None),
    )


def test_labels_beyond_the_end_of_the_video(tmp_path: Path) -> None:
    boxes = read_labels(write(tmp_path, "3,1,2,3,4,5\n12,1,2,3,4,5\n"))
    check_frames(boxes, 12, Path("gt.txt"), "clip.mp4")
    with pytest.raises(LabelError, match=r"^gt\.txt: .*frame 12\b.*clip\.mp4 .*11"):
        check_frames(boxes, 11, Path("gt.txt"), "clip.mp4")


FIELDS = st.one_of(
    st.integers(-3, 40).map(str),
    st.floats().map(str),
    st.sampled_from(["", " ", "1e400", "-0", "0x1", "1_0", "belt", "#", "\x00"]),
    st.text(max_size=4),
)
LINES = st.lists(FIELDS, max_size=11).map(",".join)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.lists(LINES, max_size=6).map("\n".join).map(str.encode), st.binary(max_size=60)))
def test_any_file_is_read_or_refused(tmp_path: Path, content: bytes) -> None:
    path = write(tmp_path, content)
    try:
        boxes = read_labels(path)
    except LabelError as error:
        told = str(error)
        assert told.startswith(str(path))
        assert len(told.splitlines()) == 1
    else:
        assert boxes
        assert all(box.frame >= 1 and box.w > 0 and box.h > 0 for box in boxes)
        assert list(boxes) == sorted(boxes, key=lambda box: (box.track, box.frame))
