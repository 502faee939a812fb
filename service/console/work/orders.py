"""What engineers may have done: each order is one `lumpwatch` command on clips of the library.

An order is checked when it is given; the command itself is put together when its turn has come, with the labels of
that moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.work.library import Library
from lumpwatch.service.console.work.tracks import to_mot
from lumpwatch.service.console.work.trials import PriorDeed
from lumpwatch.service.errors import LumpwatchError

ClipId = Annotated[str, Field(pattern=r"^\d{8}T\d{6}-[0-9a-f]{6}$")]
Clips = Annotated[tuple[ClipId, ...], Field(max_length=100)]
Version = Annotated[int, Field(ge=0, le=10_000_000)]


class OrderError(LumpwatchError):
    """An order that cannot be carried out; the text says why."""


class _Order(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str = Field(max_length=64)


class TrainOrder(_Order):
    """Learn a prior of labelled clips."""

    kind: Literal["train"]
    roi: str = Field(max_length=64)
    clips: Clips
    """Labelled ones, and such in which no lump comes."""
    folds: int = Field(default=5, ge=0, le=20)
    """Parts of the cross-validation; 0: none."""
    then: Literal["shadow", "use"] = "shadow"
    """Run it beside the prior in use, or use it where the cross-validation has nothing against it."""

    @model_validator(mode="after")
    def _parts(self) -> TrainOrder:
        if self.folds == 1:
            raise ValueError("folds: must be 0, or 2 and more")
        return self


class SuggestOrder(_Order):
    """Let the present filter propose labels for a clip."""

    kind: Literal["suggest"]
    roi: str = Field(max_length=64)
    clip: ClipId


class ReplayOrder(_Order):
    """Run the camera's pipeline on a clip and draw what it sees."""

    kind: Literal["replay"]
    clip: ClipId
    shadow: Version | None = None
    """A version of the prior to run beside the one in use."""


class BacktestOrder(_Order):
    """Judge the configuration with the prior in use at every threshold."""

    kind: Literal["backtest"]
    roi: str = Field(max_length=64)
    clips: Clips


class ReferenceOrder(_Order):
    """Learn what a fit picture of a camera looks like."""

    kind: Literal["reference"]
    clips: Clips
    """By day."""
    night: Clips = ()


Order = Annotated[
    TrainOrder | SuggestOrder | ReplayOrder | BacktestOrder | ReferenceOrder, Field(discriminator="kind")
]
ORDERS: TypeAdapter[Order] = TypeAdapter(Order)


def read_order(given: object) -> Order:
    """An order as it came. Raises OrderError naming the field."""
    try:
        return ORDERS.validate_python(given)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"][1:]) or "kind"
        raise OrderError(f"{where[:60]}: {first['msg']}") from error


def body_schemas(ref: str) -> dict[str, Any]:
    """JSON Schema of an order and all of its kinds, for documents; `ref` says where they refer to."""
    schema = ORDERS.json_schema(ref_template=ref)
    parts: dict[str, Any] = schema.pop("$defs")
    return {**parts, "Order": schema, "PriorDeed": PriorDeed.model_json_schema(ref_template=ref)}


def check_order(order: Order, config: SiteConfig, library: Library) -> str:
    """What the order is about, in words. Raises OrderError, KeyError for what is not there."""
    camera = config.camera(order.camera)
    if isinstance(order, TrainOrder | SuggestOrder | BacktestOrder):
        camera.roi(order.roi)
    names = ", ".join(library.about(clip).name for clip in clips_of(order))
    if isinstance(order, TrainOrder | BacktestOrder):
        labelled, empty = _sorted(order.clips, library)
        if isinstance(order, TrainOrder) and not labelled:
            raise OrderError("clips: none of them has a labelled lump")
        if not labelled and not empty:
            raise OrderError("clips: choose at least one")
    elif not clips_of(order):
        raise OrderError("clips: choose at least one by day")
    return names


def clips_of(order: Order) -> tuple[str, ...]:
    """All clips that an order needs."""
    if isinstance(order, SuggestOrder | ReplayOrder):
        return (order.clip,)
    if isinstance(order, ReferenceOrder):
        return (*order.clips, *order.night)
    return order.clips


def command(order: Order, config: Path, library: Library, folder: Path) -> list[str]:
    """The arguments of `lumpwatch`; label files are written to `folder`. Raises OrderError, KeyError."""
    out: list[str | Path]
    match order:
        case TrainOrder():
            labelled, empty = _sorted(order.clips, library)
            if not labelled:
                raise OrderError("none of the clips has a labelled lump any more")
            pairs = [
                path for clip in labelled for path in (library.video(clip), _labels(clip, library, folder))
            ]
            out = ["train", config, *pairs, "--camera", order.camera, "--roi", order.roi]
            out += ["--folds", str(order.folds), "--report", folder / "report.html"]
            out += ["--shadow"] if order.then == "shadow" else []
            if empty:
                out += ["--without-lumps", *(library.video(clip) for clip in empty)]
        case SuggestOrder():
            out = ["train", config, library.video(order.clip), "--camera", order.camera, "--roi", order.roi]
            out += ["--suggest", folder / "proposals.txt"]
        case ReplayOrder():
            out = ["replay", config, library.video(order.clip), "--camera", order.camera]
            out += ["--out", folder, "--plot", "--overlay"]
            out += ["--shadow", str(order.shadow)] if order.shadow is not None else []
        case BacktestOrder():
            labelled, empty = _sorted(order.clips, library)
            both = (*labelled, *empty)
            out = ["backtest", config, "--camera", order.camera, "--roi", order.roi, "--workers", "1"]
            out += ["--out", folder, "--videos", *(library.video(clip) for clip in both)]
            out += ["--labels", *(_labels(clip, library, folder) for clip in both)]
        case ReferenceOrder():
            out = ["reference", config, *(library.video(clip) for clip in order.clips)]
            out += ["--camera", order.camera]
            out += ["--night", *(library.video(clip) for clip in order.night)] if order.night else []
    return [str(part) for part in out]


def _sorted(clips: Sequence[str], library: Library) -> tuple[list[str], list[str]]:
    """Those with labelled lumps, and those in which none comes. Raises OrderError for one that nobody has labelled."""
    labelled, empty = [], []
    for clip in dict.fromkeys(clips):
        labels = library.labels(clip).labels
        if labels.tracks:
            labelled.append(clip)
        elif labels.empty:
            empty.append(clip)
        else:
            raise OrderError(f"{library.about(clip).name}: has no labels, and nobody said that no lump comes")
    return labelled, empty


def _labels(clip: str, library: Library, folder: Path) -> Path:
    path = folder / f"{clip}.txt"
    path.write_text(to_mot(library.labels(clip).labels), encoding="utf-8")
    return path
