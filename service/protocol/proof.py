"""The messages of a proof test on the bus."""

from __future__ import annotations

from base64 import b64decode
from datetime import datetime
from enum import StrEnum
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from lumpwatch.service.core import LARGEST_PX
from lumpwatch.service.protocol.messages import Record
from lumpwatch.service.protocol.requests import OptionalName, Request


class Outcome(StrEnum):
    """How a proof test ended."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    """It could not be judged, which shows nothing about the chain; it is tried again."""


class ProofReason(StrEnum):
    """Why a proof test did not pass."""

    NOT_DETECTED = "not_detected"
    """No alarm came before the lump had left."""
    TOO_LATE = "too_late"
    """The alarm left less warning than asked for."""
    NO_CAMERA = "no_camera"
    """The camera's process does not answer."""
    NO_FRAMES = "no_frames"
    """No frames with the lump came from the camera's process."""
    ERROR = "error"
    """The test filter failed; the log says why."""
    DISTURBED = "disturbed"
    """The alarm was not that of the synthetic lump, or the ROI itself was not CLEAR (inconclusive)."""
    BLIND = "blind"
    """The ROI could not judge (inconclusive)."""
    EMPTY = "empty"
    """Nothing lies on the belt (inconclusive): among ore the lump would be harder to find. Of a mouth: or nothing moves
    in it, because the feed stands."""
    STOPPED = "stopped"
    """The daemon was stopped (inconclusive)."""


_WORKS = (
    "A proof test shows that the chain from the camera's frames to the alarm works now, "
    "with this light and this prior"
)
SHOWS_DRAWN = (
    f"{_WORKS}. Its lump is drawn: it does not show that lumps like those of this site are found. A backtest on "
    "labelled footage of the site shows that."
)
"""What may be concluded from a proof test with a drawn lump, for people."""
SHOWS_LABELLED = (
    f"{_WORKS}, and whether it finds this one lump of the site, cut from the footage that the prior was trained on. It "
    "does not show how many others are found. A backtest on labelled footage that nothing was trained on shows that."
)
"""What may be concluded from one with a labelled lump."""


class ProofRequest(Request):
    """Ask for a proof test; the reply comes when it has ended."""

    actor: OptionalName = ""
    """Who asks; empty: the schedule."""


class ProofResult(Record):
    """What a proof test showed."""

    site: str
    """Site id."""
    camera: str
    """Camera id."""
    roi: str
    """ROI id."""
    time: datetime
    """When it ended (UTC)."""
    outcome: Outcome
    """Passed, failed or inconclusive."""
    reason: ProofReason | None = None
    """Why it did not pass."""
    warning_s: float | None = None
    """Seconds from the alarm until the lump would have reached the lip, or where there is no calibration
    the end of the ROI; of a mouth what was left of the time in which the alarm had to come; null: no alarm."""
    existence: float = 0.0
    """The highest probability of a lump while it was in the picture."""
    prior: int = 0
    """Version of the prior in use."""
    actor: str = ""
    """Who asked; empty: the schedule."""
    lump: str = ""
    """Which labelled lump of the site it was; empty: a drawn one."""
    shows: str = SHOWS_DRAWN
    """What may be concluded from it and what not."""


_Share = Annotated[float, Field(ge=-1.0, le=2.0, allow_inf_nan=False)]
_Side = Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)]
_Grey = Annotated[float, Field(ge=0.0, le=255.0)]


class LumpAt(Record):
    """Where the synthetic lump is at one moment; shares of the picture's width and height."""

    t_s: float = Field(ge=0.0, le=600.0)
    """Seconds since the first frame of the test."""
    x: _Share
    """Its centre."""
    y: _Share
    """Its centre."""
    w: _Side
    """Width of its box."""
    h: _Side
    """Height of its box."""


class CutPicture(Record):
    """A labelled lump, to be shown as it looked."""

    width: int = Field(ge=4, le=LARGEST_PX)
    """Columns of the picture, px; it holds the labelled box and a fifth of its sides around it."""
    height: int = Field(ge=4, le=LARGEST_PX)
    """Rows of the picture, px."""
    luma: Annotated[str, Field(max_length=(LARGEST_PX**2 + 2) // 3 * 4)]
    """Its grey levels row by row, one byte each, as base64."""
    mean: float = Field(ge=0.0, le=255.0)
    """Mean grey level of the region when it was cut."""
    spread: float = Field(gt=0.0, le=255.0)
    """Standard deviation of those."""

    @property
    def pixels(self) -> bytes:
        """`luma` again."""
        return b64decode(self.luma, validate=True)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        try:
            whole = len(self.pixels) == self.width * self.height
        except ValueError:
            whole = False
        if not whole:
            raise ValueError("luma: is not base64 of width times height bytes")
        return self


class BlendPlan(Record):
    """Asks the camera's process for frames with a synthetic lump, beside the others; a new plan ends the old."""

    roi: str
    """ROI that is tested."""
    path: Annotated[tuple[LumpAt, ...], Field(min_length=2, max_length=2000)]
    """The way of the lump, by rising time; there is none before the first moment, nor after the last."""
    lasts_s: float = Field(gt=0.0, le=600.0)
    """For how long frames are sent."""
    greys: Annotated[tuple[_Grey, ...], Field(min_length=2, max_length=256)] | None = None
    """Quantiles of the lump's brightness from dark to bright; null: somewhat brighter than its surroundings."""
    lump: CutPicture | None = None
    """The lump that is shown; null: one is drawn."""
    seed: int = Field(default=1, ge=0, lt=2**31)
    """Of its shape and grain."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        times = [at.t_s for at in self.path]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("path: the times do not rise")
        return self


class BlendReply(Record):
    """The camera's process will send the frames."""

    accepted: bool
    """Always true; what is not accepted gets an error."""
