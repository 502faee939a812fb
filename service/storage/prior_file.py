"""A prior as a file: what training learned, bound to one camera and ROI.

    lumpwatch-prior 1 <sha256 of the rest> <bytes of the rest> <newline>
    a NumPy .npz archive: the arrays, and `meta`, a JSON object

The first line makes truncation and corruption visible before anything is parsed. Arrays are read
without pickle, so that a foreign file cannot run code. What turns arrays into what a filter knows is loaded only
with a prior to read or write: it brings the numerics, which take memory and seconds.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from lumpwatch.service.config import RoiConfig
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.arrays import OutdatedError, load_arrays, within
from lumpwatch.service.storage.checksummed import SealError, seal, unseal

if TYPE_CHECKING:
    from lumpwatch.models.learning.learned import Learned

FORMAT = 1
MAX_BYTES = 64 << 20
_MOST_TEXT = 10_000
_SINCE, _UNTIL = datetime(2000, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
_ASPECT_TOLERANCE = 0.01


class PriorError(LumpwatchError):
    """A prior cannot be used; the text says which and why."""


class PriorMeta(BaseModel):
    """The description of a prior."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str
    roi: str
    created: datetime
    polygon: tuple[tuple[float, float], ...]
    aspect: float
    """Width of the pictures over their height."""
    source: str
    """Names of the training videos, without their folders."""
    frames: int
    """Frames that training used."""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        """What is stored is shown to people and reckoned with, so it must be what a training can have written."""
        texts = (self.camera, self.roi, self.source)
        if not all(text.isprintable() and len(text) <= _MOST_TEXT for text in texts):
            raise ValueError("names cannot be printed")
        if self.created.tzinfo is None or not _SINCE <= self.created < _UNTIL:
            raise ValueError("the time is none")
        within("aspect", self.aspect, 0.05, 20.0)
        if not 3 <= len(self.polygon) <= 1000:
            raise ValueError("the polygon has no corners")
        within("polygon", self.polygon, -0.01, 1.01)
        within("frames", self.frames, 0, 1e12)
        return self


@dataclass(frozen=True, slots=True)
class Prior:
    """A prior with its identity."""

    meta: PriorMeta
    learned: Learned
    version: int = 0
    """Number under which the store keeps it; 0 before it is stored."""

    def check_fits(self, roi: RoiConfig, width: int, height: int) -> None:
        """Raises PriorError where ROI or picture are not those of the training."""
        same = len(self.meta.polygon) == len(roi.polygon) and np.allclose(
            self.meta.polygon, roi.polygon, atol=1e-6
        )
        if not same:
            raise PriorError(f"prior of roi {roi.id}: was trained for another polygon; train again")
        if abs(width / height / self.meta.aspect - 1.0) > _ASPECT_TOLERANCE:
            raise PriorError(
                f"prior of roi {roi.id}: was trained on pictures of another shape "
                f"({self.meta.aspect:.3f} wide to 1 high, now {width / height:.3f}); train again"
            )

    def with_version(self, version: int) -> Prior:
        """The same prior under a version number."""
        return replace(self, version=version)


def encode_prior(prior: Prior) -> bytes:
    """The bytes of a prior file; the same prior gives the same bytes."""
    from lumpwatch.service.storage.learned_arrays import encode_learned

    described, arrays = encode_learned(prior.learned)
    meta = prior.meta.model_dump(mode="json") | described
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(meta, sort_keys=True).encode(), dtype=np.uint8)
    np.savez(buffer, allow_pickle=False, meta=text, **arrays)
    return seal("prior", FORMAT, buffer.getvalue())


def decode_prior(content: bytes, name: str) -> Prior:
    """The prior in the bytes of a file; `name` stands for it in errors. Raises PriorError."""
    from lumpwatch.service.storage.learned_arrays import decode_learned

    try:
        body = unseal("prior", FORMAT, content)
    except SealError as error:
        raise PriorError(f"{name}: {error}") from error
    try:
        arrays = load_arrays(body, MAX_BYTES)
        meta = json.loads(arrays.pop("meta").tobytes())
        learned = decode_learned(meta, arrays)
        known = {key: meta[key] for key in PriorMeta.model_fields}
        prior = Prior(PriorMeta.model_validate(known), learned)
    except OutdatedError as error:
        raise PriorError(f"{name}: {error}") from error
    except Exception as error:
        # The checksum holds, so this is another program's file: whatever is wrong, it is not a prior.
        raise PriorError(
            f"{name}: the prior's content is not as expected ({type(error).__name__})"
        ) from error
    return prior
