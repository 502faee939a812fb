"""The store's prior in shadow: beside the current one, promoted, dropped, whole after sudden death."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from lumpwatch.service.storage.atomic import replace_file
from lumpwatch.service.storage.prior_file import encode_prior
from lumpwatch.service.storage.prior_store import Found, PriorStore
from lumpwatch.service.storage.versions import StoreError
from tests.service_helpers import prior

OF = ("cam", "apron")


def stored(root: Path, *sources: str, shadow: str | None = None, keep: int = 10) -> PriorStore:
    """A store with one version for each source, the last one of them in shadow where it is given."""
    store = PriorStore(root, keep)
    for source in sources:
        store.save(prior(source=source))
    if shadow is not None:
        store.save(prior(source=shadow), shadow=True)
    return store


def source(found: Found) -> str | None:
    return None if found.prior is None else found.prior.meta.source


def damage(store: PriorStore, version: int) -> None:
    path = store.path(*OF, version)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def state(store: PriorStore) -> tuple[str | None, str | None]:
    """What is in use and what runs in shadow."""
    return source(store.current(*OF)), source(store.shadow(*OF))


def test_a_shadow_stands_beside_the_current_one(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", shadow="c")
    assert state(store) == ("b", "c")
    assert (store.pointer(*OF), store.shadow_pointer(*OF)) == (2, 3)
    assert [store.untried(*OF, v) for v in (1, 2, 3)] == [False, False, True]
    assert store.save(prior(source="d"), shadow=True).version == 4
    assert state(store) == ("b", "d")
    assert store.versions(*OF) == (1, 2, 3, 4)


def test_a_staged_version_is_neither_in_use_nor_in_shadow(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", shadow="b")
    staged = store.stage(prior(source="c"))
    assert staged.version == 3
    assert state(store) == ("a", "b")
    assert store.untried(*OF, 3)
    store.use(*OF, 3)
    assert state(store) == ("c", "b")
    assert not store.untried(*OF, 3)


def test_a_first_version_that_is_staged_leaves_the_defaults_in_use(tmp_path: Path) -> None:
    store = PriorStore(tmp_path)
    store.stage(prior(source="a"))
    assert state(store) == (None, None)


def test_staging_keeps_what_was_staged_and_what_is_in_use(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", keep=2)
    assert [store.stage(prior(source=name)).version for name in "bcd"] == [2, 3, 4]
    assert store.versions(*OF) == (1, 4)
    assert state(store) == ("a", None)


def test_promoting_and_rolling_back(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", shadow="b")
    with pytest.raises(StoreError, match=r"version 2 .*not 1"):
        store.promote(*OF, 1)
    assert store.promote(*OF, 2).version == 2
    assert state(store) == ("b", None)
    assert not store.untried(*OF, 2)
    store.use(*OF, 1)
    assert state(store) == ("a", None)
    with pytest.raises(StoreError, match="no prior runs in shadow"):
        store.promote(*OF)


def test_dropping_keeps_the_version(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", shadow="b")
    with pytest.raises(StoreError, match=r"version 2 .*not 7"):
        store.drop_shadow(*OF, 7)
    assert store.drop_shadow(*OF) == 2
    assert state(store) == ("a", None)
    assert store.versions(*OF) == (1, 2)
    with pytest.raises(StoreError, match="no prior runs in shadow"):
        store.drop_shadow(*OF)
    store.set_shadow(*OF, 2)
    assert state(store) == ("a", "b")


def test_what_cannot_run_in_shadow(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b")
    with pytest.raises(StoreError, match="version 2 is in use"):
        store.set_shadow(*OF, 2)
    with pytest.raises(StoreError, match="no version 9"):
        store.set_shadow(*OF, 9)
    store.set_shadow(*OF, 1)
    store.use(*OF, 1)
    assert state(store) == ("a", None)


def test_a_first_prior_in_shadow_leaves_the_defaults_in_use(tmp_path: Path) -> None:
    store = stored(tmp_path, shadow="a")
    assert state(store) == (None, "a")
    assert store.current(*OF) == Found(None)
    store.promote(*OF)
    assert state(store) == ("a", None)
    store.use_defaults(*OF)
    assert store.current(*OF) == Found(None)
    assert store.pointer(*OF) == 0
    assert store.save(prior(source="b")).version == 2
    assert state(store) == ("b", None)


def test_what_was_never_in_use_stands_in_for_nothing(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", shadow="b")
    store.drop_shadow(*OF)
    store.save(prior(source="c"))
    damage(store, 3)
    assert source(store.current(*OF)) == "a"
    (store.folder(*OF) / "current").unlink()
    damage(store, 1)
    assert source(store.current(*OF)) is None


def test_a_damaged_shadow_is_told_and_nothing_stands_in(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", shadow="c")
    damage(store, 3)
    found = store.shadow(*OF)
    assert found.prior is None
    assert len(found.problems) == 1
    assert "is corrupt" in found.problems[0]
    assert source(store.current(*OF)) == "b"
    with pytest.raises(Exception, match="is corrupt"):
        store.promote(*OF)
    assert state(store) == ("b", None)
    assert store.shadow_pointer(*OF) == 3


def test_old_trials_are_removed_before_what_was_in_use(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", "b", keep=3)
    for k in range(5):
        store.save(prior(source=f"s{k}"), shadow=True)
    assert store.versions(*OF) == (1, 2, 7)
    assert state(store) == ("b", "s4")
    store.promote(*OF)
    store.use(*OF, 2)
    assert sorted(path.name for path in store.folder(*OF).iterdir()) == [
        "000001.prior",
        "000002.prior",
        "000007.prior",
        "current",
    ]


@pytest.mark.parametrize("after", range(4))
def test_a_promotion_that_ends_on_the_way_leaves_one_of_the_two(tmp_path: Path, after: int) -> None:
    """Every prefix of its writes: the mark, the pointer in use, the pointer of the shadow."""
    store = stored(tmp_path, "a", shadow="b")
    folder, mark = store.folder(*OF), store.path(*OF, 2).with_suffix(".trial")
    deeds: tuple[Callable[[], None], ...] = (
        lambda: replace_file(folder / "current", b"2\n"),
        mark.unlink,
        (folder / "shadow").unlink,
    )
    for deed in deeds[:after]:
        deed()
    assert state(store) == (("a", "b") if after == 0 else ("b", None))
    store.save(prior(source="c"))
    damage(store, 3)
    assert source(store.current(*OF)) == ("a" if after == 0 else "b")


def _promote_on_and_on(root: Path) -> None:
    """What the victim does: promote the shadow, put the other version into it, and so on."""
    store = PriorStore(root)
    while True:
        store.promote(*OF)
        store.set_shadow(*OF, 3 - (store.pointer(*OF) or 0))


@pytest.mark.slow
def test_promotions_that_are_killed_leave_a_store_that_is_whole(tmp_path: Path) -> None:
    store = stored(tmp_path / "var", "a", shadow="b")
    fork = multiprocessing.get_context("fork")  # at once where the modules are: it is killed at once as well
    for k in range(20):
        if store.shadow_pointer(*OF) is None:
            store.set_shadow(*OF, 3 - (store.pointer(*OF) or 0))
        before = store.pointer(*OF)
        victim = fork.Process(target=_promote_on_and_on, args=(store.root,), daemon=True)
        victim.start()
        deadline = time.monotonic() + 60
        while store.pointer(*OF) == before:
            assert time.monotonic() < deadline
        time.sleep(0.0007 * k)
        victim.kill()
        victim.join(timeout=30)
        assert victim.exitcode == -signal.SIGKILL
        in_use, shadow = store.current(*OF), store.shadow(*OF)
        assert in_use.problems == shadow.problems == ()
        assert source(in_use) in ("a", "b")
        assert source(shadow) in {None, "a", "b"} - {source(in_use)}


def test_savers_of_both_kinds_never_take_the_same_number(tmp_path: Path) -> None:
    """A number whose mark or file another process has just made is passed over."""
    store = stored(tmp_path, "a")
    store.path(*OF, 2).with_suffix(".trial").write_bytes(b"")
    assert store.save(prior(source="b"), shadow=True).version == 3
    assert store.save(prior(source="c")).version == 4
    store.path(*OF, 5).with_suffix(".trial").write_bytes(b"")  # left behind by one that died
    assert store.save(prior(source="d")).version == 5
    assert not store.untried(*OF, 5)


def test_a_shadow_of_another_roi_is_refused(tmp_path: Path) -> None:
    store = stored(tmp_path, "a", shadow="b")
    store.path(*OF, 2).write_bytes(encode_prior(prior(roi="chute")))
    (problem,) = store.shadow(*OF).problems
    assert "belongs to camera cam, roi chute" in problem


@pytest.mark.parametrize("text", ["", "two\n", "-1\n"])
def test_a_shadow_that_cannot_be_read_is_none(tmp_path: Path, text: str) -> None:
    store = stored(tmp_path, "a", shadow="b")
    (store.folder(*OF) / "shadow").write_text(text)
    assert state(store) == ("a", None)
