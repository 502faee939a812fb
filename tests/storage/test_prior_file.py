"""The file of a prior: exact, checksummed, and refused with one line where anything is wrong."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.learning import LumpFit
from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.models.likelihood.patterns import Patterns
from lumpwatch.models.state import X, Y
from lumpwatch.service.storage.prior_file import PriorError, decode_prior, encode_prior
from tests.service_helpers import bright_fit, camera, learned, lump_fit, prior, same

KINDS = {
    "histogram": prior(learned(likelihood=bright_fit())),
    "colour": prior(learned(likelihood=bright_fit("colour"))),
    "lump": prior(learned(("belt", "fall"), lump_fit())),
}
CONTENT = encode_prior(KINDS["lump"])


def sealed(body: bytes) -> bytes:
    """A file with a right checksum around any body."""
    return b"lumpwatch-prior 1 %s %d\n" % (hashlib.sha256(body).hexdigest().encode(), len(body)) + body


def body_of(content: bytes) -> bytes:
    return content.split(b"\n", 1)[1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_prior_survives_its_file_exactly(kind: str) -> None:
    assert same(decode_prior(encode_prior(KINDS[kind]), "x"), KINDS[kind])


def test_a_density_over_two_components_survives() -> None:
    grid = GridDensity((X, Y), np.array([-0.1, 0.3]), np.array([0.1, 0.2]), np.arange(24.0).reshape(1, 4, 6))
    kept = prior(replace(learned(), density=grid))
    assert same(decode_prior(encode_prior(kept), "x"), kept)


def test_the_same_prior_gives_the_same_bytes() -> None:
    for kept in KINDS.values():
        assert encode_prior(decode_prior(encode_prior(kept), "x")) == encode_prior(kept)


@settings(deadline=None)
@given(st.integers(0, len(CONTENT) - 1), st.integers(1, 255))
def test_any_changed_byte_is_refused(place: int, change: int) -> None:
    damaged = bytearray(CONTENT)
    damaged[place] ^= change
    with pytest.raises(PriorError, match=r"^demo: "):
        decode_prior(bytes(damaged), "demo")


@pytest.mark.parametrize("place", range(CONTENT.index(b"\n") + 1))
def test_every_byte_of_the_first_line_counts(place: int) -> None:
    for bit in range(8):
        damaged = bytearray(CONTENT)
        damaged[place] ^= 1 << bit
        with pytest.raises(PriorError):
            decode_prior(bytes(damaged), "demo")


@settings(deadline=None)
@given(st.integers(0, len(CONTENT) - 1))
def test_any_truncation_is_refused(length: int) -> None:
    with pytest.raises(PriorError, match=r"^demo: "):
        decode_prior(CONTENT[:length], "demo")


@settings(deadline=None)
@given(st.binary(min_size=1, max_size=8))
def test_bytes_to_spare_are_refused(more: bytes) -> None:
    with pytest.raises(PriorError, match="truncated"):
        decode_prior(CONTENT + more, "demo")


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_other_file_is_refused(content: bytes) -> None:
    with pytest.raises(PriorError):
        decode_prior(content, "demo")


def test_another_format_is_named() -> None:
    with pytest.raises(PriorError, match=r"^demo: .*format 2\b.*format 1$"):
        decode_prior(CONTENT.replace(b"lumpwatch-prior 1 ", b"lumpwatch-prior 2 ", 1), "demo")


class _Trap:
    """Says so when it is unpickled."""

    sprung = False

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _spring, ()


def _spring() -> str:
    _Trap.sprung = True
    return ""


def test_a_pickled_archive_is_refused_without_running_it() -> None:
    _Trap.sprung = False
    for name in ("meta", "rates"):
        with np.load(io.BytesIO(body_of(CONTENT))) as archive:
            arrays = {key: archive[key] for key in archive.files}
        arrays[name] = np.array([_Trap()], dtype=object)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        with pytest.raises(PriorError, match="not as expected"):
            decode_prior(sealed(buffer.getvalue()), "demo")
    assert not _Trap.sprung


def _altered(name: str, value: object) -> bytes:
    """A file with a right checksum in which one array, or one entry of the meta data, is another."""
    with np.load(io.BytesIO(body_of(CONTENT))) as archive:
        arrays = {key: archive[key] for key in archive.files}
    if isinstance(value, np.ndarray):
        arrays[name] = value
    else:
        meta = json.loads(arrays["meta"].tobytes())
        meta[name] = value
        arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return sealed(buffer.getvalue())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rates", np.zeros((3, 2))),
        ("joint", np.zeros((2, 3))),
        ("births", np.array([0.5, np.nan])),
        ("density_values", np.ones((1, 11))),
        ("density_values", np.ones((2, 11, 2))),
        ("profile_mean", np.full((5, 4), np.inf)),
        ("fit_line", np.zeros(0)),
        ("profile_rows", np.zeros(1)),
        ("models", ["belt"]),
        ("models", 7),
        ("components", "y"),
        ("polygon", "everywhere"),
        ("created", "yesterday"),
        ("interval_s", None),
        ("frames", "many"),
        ("meta", np.zeros(3, np.uint8)),
        ("meta", np.frombuffer(b"[1]", np.uint8)),
    ],
)
def test_content_that_cannot_be_right_is_refused(name: str, value: object) -> None:
    with pytest.raises(PriorError, match=r"^demo: .*not as expected"):
        decode_prior(_altered(name, value), "demo")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fit_mean", np.zeros(7)),
        ("fit_weights", np.zeros(8)),
        ("profile_mean", np.zeros((5, 2))),
        ("profile_spread", np.zeros((3, 4))),
        ("density_origin", np.zeros(0)),
        ("components", [40]),
    ],
)
def test_shapes_of_profile_and_fit_are_checked(name: str, value: object) -> None:
    with pytest.raises(PriorError):
        decode_prior(_altered(name, value), "demo")


@pytest.mark.parametrize("features", [8, 68])
def test_a_prior_from_before_the_net_asks_for_training(features: int) -> None:
    before = LumpFit(np.zeros(features), np.ones(features), np.zeros(2 * features), 0.25)
    with pytest.raises(
        PriorError, match="demo: was trained by a version with other measures of a box: train again"
    ):
        decode_prior(encode_prior(prior(learned(likelihood=before))), "demo")


def test_the_name_of_the_net_is_kept() -> None:
    fit = decode_prior(
        encode_prior(prior(learned(likelihood=replace(lump_fit(), net="0123456789abcdef")))), "demo"
    )
    assert isinstance(fit.learned.likelihood, LumpFit)
    assert fit.learned.likelihood.net == "0123456789abcdef"


def test_a_prior_from_before_the_margin_has_none() -> None:
    body = io.BytesIO(body_of(encode_prior(prior(learned(likelihood=replace(lump_fit(), margin=1.75))))))
    with np.load(body, allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive.files}
    for margin in ([1.75], None):
        arrays.pop("fit_margin")
        if margin is not None:
            arrays["fit_margin"] = np.array(margin)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        fit = decode_prior(sealed(buffer.getvalue()), "demo").learned.likelihood
        assert isinstance(fit, LumpFit)
        assert fit.margin == (0.0 if margin is None else 1.75)


def test_patterns_are_kept() -> None:
    rng = np.random.default_rng(0)
    patterns = Patterns(rng.normal(size=(3, len(FEATURES))), rng.normal(size=3))
    fit = replace(lump_fit(), weights=rng.normal(size=2 * len(FEATURES) + 3), patterns=patterns)
    kept = decode_prior(encode_prior(prior(learned(likelihood=fit))), "demo").learned.likelihood
    assert isinstance(kept, LumpFit)
    assert np.array_equal(kept.patterns.directions, patterns.directions)
    assert np.array_equal(kept.patterns.offsets, patterns.offsets)
    assert np.array_equal(kept.weights, fit.weights)
    for wrong in (
        replace(fit, weights=fit.weights[:-1]),
        replace(fit, patterns=Patterns(patterns.directions[:, 1:], patterns.offsets)),
        replace(fit, patterns=Patterns(patterns.directions, patterns.offsets[1:])),
    ):
        with pytest.raises(PriorError):
            decode_prior(encode_prior(prior(learned(likelihood=wrong))), "demo")


def test_an_array_file_in_place_of_an_archive_is_refused() -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    for body in (buffer.getvalue(), b"PK\x03\x04", b"\x80\x04N."):
        with pytest.raises(PriorError):
            decode_prior(sealed(body), "demo")


def _unknown_compression() -> bytes:
    body = bytearray(body_of(CONTENT))
    entry = body.index(b"PK\x01\x02")
    body[entry + 10] = 97  # the compression method of the first file in the archive's directory
    return bytes(body)


def _boundless() -> bytes:
    """An array that claims to hold 8 PB."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("meta.npy", head.getvalue())
    return buffer.getvalue()


@pytest.mark.parametrize("body", [b"", _unknown_compression(), _boundless()])
def test_an_archive_that_the_reader_trips_over_is_refused(body: bytes) -> None:
    with pytest.raises(PriorError):
        decode_prior(sealed(body), "demo")


def test_a_prior_fits_its_own_roi_and_shape_only() -> None:
    kept, roi = KINDS["histogram"], camera().rois[0]
    kept.check_fits(roi, 96, 64)
    kept.check_fits(roi, 192, 128)
    with pytest.raises(PriorError, match=r"another shape \(1\.500 .*1\.333\)"):
        kept.check_fits(roi, 640, 480)
    moved = roi.model_copy(update={"polygon": (*roi.polygon[:3], (0.1, 0.8))})
    with pytest.raises(PriorError, match=r"roi apron: .*another polygon"):
        kept.check_fits(moved, 96, 64)
    with pytest.raises(PriorError, match="another polygon"):
        kept.check_fits(roi.model_copy(update={"polygon": roi.polygon[:3]}), 96, 64)
