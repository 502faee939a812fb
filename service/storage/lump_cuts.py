"""The labelled lumps that a training cut for proof tests, as a file beside its prior.

lumpwatch-lumps 1 <sha256 of the rest> <bytes of the rest> <newline>
a NumPy .npz archive: `names` (JSON), `boxes` (n, 4), `tones` (n, 2), `picture0`, `picture1`, …
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.core import LARGEST_PX, LumpCut
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.arrays import load_arrays, within
from lumpwatch.service.storage.checksummed import SealError, seal, unseal

FORMAT = 1
MOST_BYTES = 4 << 20
_MOST_NAME = 200
_LEAST_PX = 4


class LumpCutError(LumpwatchError):
    """A file of cut lumps cannot be used; the text says which and why."""


def encode_cuts(cuts: Sequence[LumpCut]) -> bytes:
    """The bytes of a file; the same lumps give the same bytes."""
    names = np.frombuffer(json.dumps([cut.name[:_MOST_NAME] for cut in cuts]).encode(), dtype=np.uint8)
    pictures: dict[str, NDArray[np.uint8]] = {f"picture{k}": cut.picture for k, cut in enumerate(cuts)}
    buffer = io.BytesIO()
    np.savez(
        buffer,
        allow_pickle=False,
        names=names,
        boxes=np.array([cut.box for cut in cuts]).reshape(-1, 4),
        tones=np.array([cut.tone for cut in cuts]).reshape(-1, 2),
        **pictures,
    )
    return seal("lumps", FORMAT, buffer.getvalue())


def decode_cuts(content: bytes, name: str) -> tuple[LumpCut, ...]:
    """The lumps in the bytes of a file; `name` stands for it in errors. Raises LumpCutError."""
    try:
        arrays = load_arrays(unseal("lumps", FORMAT, content), MOST_BYTES)
        names = json.loads(arrays["names"].tobytes())
        within("boxes", arrays["boxes"], -10.0, 10.0)
        within("tones", arrays["tones"], 0.0, 255.0)
        return tuple(
            _cut(str(names[k]), arrays[f"picture{k}"], arrays["boxes"][k], arrays["tones"][k])
            for k in range(len(names))
        )
    except SealError as error:
        raise LumpCutError(f"{name}: {error}") from error
    except Exception as error:
        # The checksum holds, so this is another program's file: whatever is wrong, it holds no lumps.
        raise LumpCutError(f"{name}: the content is not as expected ({type(error).__name__})") from error


def _cut(
    name: str, picture: NDArray[np.uint8], box: NDArray[np.float64], tone: NDArray[np.float64]
) -> LumpCut:
    if not name.isprintable() or len(name) > _MOST_NAME:
        raise ValueError("a name cannot be printed")
    if picture.dtype != np.uint8 or picture.ndim != 2:
        raise ValueError("a picture is none")
    if not (min(picture.shape) >= _LEAST_PX and max(picture.shape) <= LARGEST_PX):
        raise ValueError("a picture has another size")
    x, y, w, h = (float(value) for value in box)
    if not (w > 0 and h > 0 and tone[1] > 0):
        raise ValueError("a lump has no size")
    return LumpCut(name, picture, (x, y, w, h), (float(tone[0]), float(tone[1])))
