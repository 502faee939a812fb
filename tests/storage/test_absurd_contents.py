"""Priors, references and pointers with a right checksum and contents that no training writes."""

from __future__ import annotations

import copy
import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning.learned import Learned, LumpFit
from lumpwatch.service.evidence.state_file import StateError, decode_state
from lumpwatch.service.storage.arrays import load_arrays
from lumpwatch.service.storage.prior_file import Prior, PriorError, decode_prior, encode_prior
from lumpwatch.service.storage.reference_store import BadReferenceError, decode
from lumpwatch.service.storage.versions import Versions
from tests.service_helpers import learned, lump_fit, prior
from tests.storage.test_prior_file import body_of, sealed

GOOD = prior(learned(("belt", "fall"), lump_fit()))


def _learned(**changes: Any) -> Callable[[Learned], Learned]:
    return lambda before: replace(before, **changes)


def _scaled(name: str, factor: float) -> Callable[[Learned], Learned]:
    return lambda before: replace(before, **{name: getattr(before, name) * factor})


def _fit(**changes: Any) -> Callable[[Learned], Learned]:
    def change(before: Learned) -> Learned:
        assert isinstance(before.likelihood, LumpFit)
        return replace(before, likelihood=replace(before.likelihood, **changes))

    return change


def _forced(profile: RowProfile, **changes: object) -> RowProfile:
    """With numbers that the profile itself would refuse, as a damaged file may hold them."""
    made = copy.copy(profile)
    for name, value in changes.items():
        object.__setattr__(made, name, value)
    return made


@pytest.mark.parametrize(
    "change",
    [
        _learned(rates=np.full((2, 2), 1e9)),
        _scaled("velocity_noise", -1.0),
        _scaled("velocity_noise", 1e300),
        _scaled("joint", -1.0),
        _scaled("joint", 0.0),
        _scaled("births", 0.0),
        _scaled("births", -1.0),
        _learned(interval_s=0.0),
        _learned(interval_s=-1.0),
        _learned(interval_s=float("nan")),
        _learned(models=("belt", "belt")),
        _learned(models=("belt", "\x1b[2J")),
        _learned(tracks=-1),
        _fit(margin=1e9),
        _fit(margin=-1e9),
        _fit(looks_per_s=1e-9),
        _fit(offset=-1e6),
        lambda before: replace(before, density=replace(before.density, step=before.density.step * 0)),
        lambda before: replace(before, density=replace(before.density, values=-before.density.values - 1)),
        lambda before: replace(before, profile=_forced(before.profile, row_step=0.0)),
        lambda before: replace(before, profile=replace(before.profile, mean=before.profile.mean + 1e6)),
        lambda before: replace(before, profile=_forced(before.profile, spread=-before.profile.spread - 1)),
        lambda before: _fit(scale=before.likelihood.scale * 0)(before),
        lambda before: _fit(weights=before.likelihood.weights + 1e6)(before),
    ],
)
def test_a_prior_with_absurd_numbers_is_refused(change: Callable[[Learned], Learned]) -> None:
    absurd = Prior(GOOD.meta, change(GOOD.learned))
    with pytest.raises(PriorError, match=r"^x: "):
        decode_prior(encode_prior(absurd), "x")


@pytest.mark.parametrize(
    "meta",
    [
        {"aspect": 0.0},
        {"aspect": float("inf")},
        {"created": datetime(1, 1, 1)},
        {"created": datetime.fromisoformat("9999-12-31T23:59:59+00:00")},
        {"polygon": ()},
        {"polygon": ((0.0, 0.0), (1e300, 0.0), (1.0, 1.0))},
        {"source": "a\nforged line"},
        {"source": "\x1b]0;x\x07"},
        {"source": "x" * 1_000_000},
    ],
)
def test_a_prior_with_an_absurd_description_is_refused(meta: dict[str, Any]) -> None:
    absurd = Prior(GOOD.meta.model_copy(update=meta), GOOD.learned)
    with pytest.raises(PriorError, match=r"^x: "):
        decode_prior(encode_prior(absurd), "x")


def _bomb() -> bytes:
    """A megabyte that unpacks to one gigabyte."""
    buffer = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|u1", "fortran_order": False, "shape": (1 << 30,)}
    )
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("meta.npy", "w", force_zip64=True) as member,
    ):
        member.write(header.getvalue())
        for _ in range(256):
            member.write(bytes(1 << 20))
    return buffer.getvalue()


def test_a_bomb_is_not_unpacked() -> None:
    bomb = _bomb()
    with pytest.raises(ValueError, match="more than there can be"):
        load_arrays(bomb, 64 << 20)
    with pytest.raises(PriorError):
        decode_prior(sealed(bomb), "x")
    with pytest.raises(BadReferenceError):
        decode(sealed(bomb).replace(b"lumpwatch-prior", b"lumpwatch-reference", 1), "x")
    with pytest.raises(StateError):
        decode_state(bomb, "x", None)


def test_arrays_of_objects_and_texts_are_refused() -> None:
    buffer = io.BytesIO()
    np.savez(buffer, meta=np.array(["text"]))
    with pytest.raises(ValueError, match="no array of numbers"):
        load_arrays(buffer.getvalue(), 1 << 20)
    assert load_arrays(body_of(encode_prior(GOOD)), 1 << 20)


@pytest.mark.parametrize("text", ["9" * 5000, "²", "-1", "1e3", "", "\x00", "١", "3" * 12])
def test_an_odd_pointer_points_nowhere(tmp_path: Path, text: str) -> None:
    (tmp_path / "current").write_text(text, encoding="utf-8")
    (tmp_path / f"{'8' * 200}.prior").write_bytes(b"")
    versions = Versions(tmp_path, ".prior")
    assert versions.pointer is None
    assert versions.all() == ()
