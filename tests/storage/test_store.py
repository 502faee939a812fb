"""The store of priors: versioned, atomic under concurrency and sudden death, watched for new ones."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.state import Y
from lumpwatch.service.storage.atomic import replace_file, write_new_file
from lumpwatch.service.storage.prior_file import PriorError, encode_prior
from lumpwatch.service.storage.prior_store import Found, PriorStore, check_owner, read_file
from lumpwatch.service.storage.versions import StoreError
from tests.service_helpers import learned, prior, same


def stored(root: Path, *sources: str, keep: int = 10) -> PriorStore:
    """A store with one version for each source."""
    store = PriorStore(root, keep)
    for source in sources:
        store.save(prior(source=source))
    return store


def test_versions_count_from_one_and_the_newest_is_used(tmp_path: Path) -> None:
    store = PriorStore(tmp_path / "var")
    assert store.versions("cam", "apron") == ()
    assert store.current("cam", "apron") == Found(None)
    assert store.save(prior(source="a.mp4")).version == 1
    assert store.save(prior(source="b.mp4")).version == 2
    assert store.versions("cam", "apron") == (1, 2)
    assert store.pointer("cam", "apron") == 2
    found = store.current("cam", "apron")
    assert found.problems == ()
    assert found.prior is not None
    assert same(found.prior, prior(source="b.mp4", version=2))
    assert store.current("cam", "chute") == Found(None)


def test_rolling_back_and_storing_again(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", "c")
    assert store.use("cam", "apron", 1).meta.source == "a"
    assert _source_in_use(store) == "a"
    assert store.save(prior(source="d")).version == 4
    assert _source_in_use(store) == "d"
    assert store.versions("cam", "apron") == (1, 2, 3, 4)


def _source_in_use(store: PriorStore) -> str | None:
    found = store.current("cam", "apron").prior
    return None if found is None else found.meta.source


def test_a_version_that_is_not_there_or_not_whole_is_not_used(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b")
    with pytest.raises(StoreError, match="no version 9"):
        store.use("cam", "apron", 9)
    _damage(store, 1)
    with pytest.raises(PriorError, match="corrupt"):
        store.use("cam", "apron", 1)
    assert store.pointer("cam", "apron") == 2


def _damage(store: PriorStore, version: int) -> None:
    path = store.path("cam", "apron", version)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def test_a_damaged_version_falls_back_to_the_newest_older_one(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", "c")
    _damage(store, 3)
    found = store.current("cam", "apron")
    assert found.prior is not None
    assert (found.prior.version, found.prior.meta.source) == (2, "b")
    assert len(found.problems) == 1
    assert found.problems[0].startswith(str(store.path("cam", "apron", 3)))
    _damage(store, 2)
    _damage(store, 1)
    found = store.current("cam", "apron")
    assert found.prior is None
    assert len(found.problems) == 3


def test_after_a_rollback_newer_versions_are_not_used(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", "c")
    store.use("cam", "apron", 2)
    _damage(store, 2)
    assert _source_in_use(store) == "a"


def test_a_missing_version_in_use_is_told(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b")
    store.path("cam", "apron", 2).unlink()
    found = store.current("cam", "apron")
    assert found.prior is not None
    assert found.prior.version == 1
    assert found.problems == (f"{store.path('cam', 'apron', 2)}: the version in use is missing",)


@pytest.mark.parametrize("text", ["", "two\n", "-1\n", "\xff\n"])
def test_without_a_readable_pointer_the_newest_is_used(tmp_path: Path, text: str) -> None:
    store = stored(tmp_path, "a", "b")
    (store.folder("cam", "apron") / "current").write_text(text, encoding="latin-1")
    assert store.pointer("cam", "apron") is None
    assert _source_in_use(store) == "b"
    (store.folder("cam", "apron") / "current").unlink()
    assert _source_in_use(store) == "b"


def test_the_prior_of_another_roi_is_refused(tmp_path: Path) -> None:
    store = stored(tmp_path, "a")
    store.path("cam", "apron", 2).write_bytes(encode_prior(prior(camera_id="other")))
    with pytest.raises(PriorError, match=r"camera other, roi apron, not .*camera cam, roi apron"):
        store.load("cam", "apron", 2)
    with pytest.raises(PriorError, match="camera cam, roi chute"):
        check_owner(prior(roi="chute"), "cam", "apron", "x")
    (store.folder("cam", "apron") / "current").write_text("2\n")
    found = store.current("cam", "apron")
    assert found.prior is not None
    assert found.prior.version == 1
    assert len(found.problems) == 1


def test_old_versions_are_removed_but_never_the_one_in_use(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", "c", "d", keep=3)
    assert store.versions("cam", "apron") == (2, 3, 4)
    store.use("cam", "apron", 2)
    assert store.save(prior(source="e")).version == 5
    assert store.versions("cam", "apron") == (3, 4, 5)
    assert _source_in_use(store) == "e"


def test_a_foreign_file_in_the_folder_does_no_harm(tmp_path: Path) -> None:
    store = stored(tmp_path, "a")
    folder = store.folder("cam", "apron")
    for name in ("readme.txt", "copy of 000001.prior", ".000002.prior.x1.tmp", "-3.prior"):
        (folder / name).write_bytes(b"x")
    assert store.versions("cam", "apron") == (1,)
    assert store.save(prior(source="b")).version == 2


def test_a_foreign_file_with_an_odd_digit_does_no_harm(tmp_path: Path) -> None:
    store = stored(tmp_path, "a")
    (store.folder("cam", "apron") / "².prior").write_bytes(b"x")
    assert store.versions("cam", "apron") == (1,)


def test_a_store_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    for root in (tmp_path / "file", Path("/proc/lumpwatch")):
        with pytest.raises(StoreError) as caught:
            PriorStore(root).save(prior())
        told = str(caught.value)
        assert told.startswith(f"{root}/priors/cam/apron: cannot be ")
        assert len(told.splitlines()) == 1


def test_a_store_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    folder = PriorStore(tmp_path).folder("cam", "apron")
    folder.parent.mkdir(parents=True)
    folder.write_text("not a folder")
    with pytest.raises(StoreError, match="apron: cannot be read"):
        PriorStore(tmp_path).current("cam", "apron")


def test_a_pointer_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b")
    pointer = store.folder("cam", "apron") / "current"
    pointer.unlink()
    pointer.mkdir()
    with pytest.raises(StoreError, match="cannot be written"):
        store.use("cam", "apron", 1)
    with pytest.raises(StoreError, match="cannot be written"):
        store.save(prior(source="c"))
    assert not list(store.folder("cam", "apron").glob(".*.tmp"))


def test_reading_a_file_that_is_not_there_or_too_large(tmp_path: Path) -> None:
    with pytest.raises(PriorError, match=r"none\.prior: cannot be read"):
        read_file(tmp_path / "none.prior")
    with (tmp_path / "big.prior").open("wb") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(PriorError, match=r"big\.prior: .*64 MiB"):
        read_file(tmp_path / "big.prior")


# Atomic files


def test_a_new_file_never_replaces_another(tmp_path: Path) -> None:
    path = tmp_path / "x"
    assert write_new_file(path, b"one")
    assert not write_new_file(path, b"two")
    assert path.read_bytes() == b"one"
    replace_file(path, b"three")
    assert path.read_bytes() == b"three"
    assert [p.name for p in tmp_path.iterdir()] == ["x"]


def saver(root: Path, file: Path, name: str, count: int) -> subprocess.Popen[bytes]:
    """A process that stores the prior of a file again and again."""
    command = [sys.executable, "-m", "tests.store_saver", str(root), str(file), name, str(count)]
    return subprocess.Popen(command, cwd=Path(__file__).parents[2])


@pytest.mark.slow
def test_concurrent_saves_all_survive(tmp_path: Path) -> None:
    file, root = tmp_path / "some.prior", tmp_path / "var"
    file.write_bytes(encode_prior(prior()))
    savers = [saver(root, file, f"s{i}", 8) for i in range(3)]
    assert [one.wait(timeout=120) for one in savers] == [0, 0, 0]
    store = PriorStore(root)
    assert store.versions("cam", "apron") == tuple(range(1, 25))
    sources = {store.load("cam", "apron", v).meta.source for v in store.versions("cam", "apron")}
    assert sources == {f"s{i}-{k}" for i in range(3) for k in range(8)}
    found = store.current("cam", "apron")
    assert found.prior is not None
    assert found.problems == ()


@pytest.mark.slow
def test_a_killed_save_never_leaves_a_version_that_cannot_be_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).random((1, 800_000))  # 6 MB: a save takes long enough to be hit
    grid = GridDensity((Y,), np.array([0.0]), np.array([1e-6]), values)
    file, root = tmp_path / "large.prior", tmp_path / "var"
    file.write_bytes(encode_prior(prior(replace(learned(), density=grid))))
    store = PriorStore(root)
    store.save(prior(source="first"))
    rng = np.random.default_rng(7)
    for _ in range(5):
        before = store.versions("cam", "apron")[-1]
        victim = saver(root, file, "victim", 1000)
        deadline = time.monotonic() + 60
        while store.versions("cam", "apron")[-1] < before + 2:
            assert time.monotonic() < deadline
            time.sleep(0.002)
        time.sleep(float(rng.uniform(0, 0.2)))
        victim.kill()
        assert victim.wait(timeout=30) == -signal.SIGKILL
        found = store.current("cam", "apron")
        assert found.problems == ()
        assert found.prior is not None
        assert found.prior.version > before
        for stored_version in store.versions("cam", "apron"):
            store.load("cam", "apron", stored_version)
    assert store.save(prior(source="last")).version == store.pointer("cam", "apron")
