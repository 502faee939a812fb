"""Kernels that an image brings: where numba looks afterwards, once an image, and never a reason not to start."""

from __future__ import annotations

from pathlib import Path

import pytest

from lumpwatch.service.cli.compiled import FROM, TO, unpack_kernels


@pytest.fixture
def image(tmp_path: Path) -> Path:
    folder = tmp_path / "image" / "jdt_12"
    folder.mkdir(parents=True)
    (folder / "filter.step-1.py311.nbi").write_bytes(b"index")
    (folder / "filter.step-1.py311.1.nbc").write_bytes(b"code")
    (folder / "note.txt").write_text("no kernel")
    return tmp_path / "image"


def test_they_are_copied_once_and_again_for_another_image(image: Path, tmp_path: Path) -> None:
    environ = {FROM: str(image), TO: str(tmp_path / "store" / "kernels")}
    assert unpack_kernels(environ) == 2
    kept = tmp_path / "store/kernels/jdt_12"
    assert sorted(path.name for path in kept.iterdir()) == [
        "filter.step-1.py311.1.nbc",
        "filter.step-1.py311.nbi",
    ]
    (kept / "own.nbi").write_bytes(b"compiled here")
    assert unpack_kernels(environ) == 0
    (image / "jdt_12" / "filter.step-1.py311.nbi").write_bytes(b"newer index")
    assert unpack_kernels(environ) == 2
    assert (kept / "filter.step-1.py311.nbi").read_bytes() == b"newer index"
    assert (kept / "own.nbi").exists()


def test_without_an_image_or_a_store_that_can_be_written_nothing_happens(image: Path, tmp_path: Path) -> None:
    assert unpack_kernels({}) == 0
    assert unpack_kernels({FROM: str(image)}) == 0
    assert unpack_kernels({FROM: str(tmp_path / "none"), TO: str(tmp_path / "store")}) == 0
    (tmp_path / "file").write_text("in the way")
    assert unpack_kernels({FROM: str(image), TO: str(tmp_path / "file" / "kernels")}) == 0
