"""The live region step on the pictures of a training: what the region would have said, by what was learned."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime

from lumpwatch.models.learning import LabelledView, Learned
from lumpwatch.service.belt import make_pace
from lumpwatch.service.config import RoiConfig, SightConfig
from lumpwatch.service.core import Pace
from lumpwatch.service.detection import MakeDetector, RegionChannel, make_detector
from lumpwatch.service.storage import Prior, PriorMeta
from lumpwatch.service.training.footage import Footage, Moment

Picture = tuple[LabelledView, Moment]

_CREATED = datetime(2000, 1, 1, tzinfo=UTC)


def watch(
    roi: RoiConfig,
    footage: Footage,
    learned: Learned,
    wanted: Callable[[Moment], bool] = lambda moment: True,
    make: MakeDetector = make_detector,
) -> Iterator[tuple[Picture, RegionChannel]]:
    """Step through the wanted pictures, as often as the region is decided on; gives each with the channel after it.

    The channel begins anew with each clip.
    """
    pictures: Iterable[Picture] = zip(footage.views, footage.moments, strict=True)
    clip: int | None = None
    pace = Pace()
    channel = RegionChannel(roi, None, make=make)
    for view, moment in pictures:
        if not wanted(moment):
            continue
        if moment.clip != clip:
            clip = moment.clip
            pace = make_pace(roi, SightConfig(), footage.width, footage.height)
            channel = RegionChannel(roi, bound(roi, footage, learned), make=make)
            channel.fit(footage.width, footage.height)
        if not pace.take(moment.time_s):
            continue
        channel.step_working(view.view.gray, view.view.colour, moment.time_s)
        yield (view, moment), channel


def bound(roi: RoiConfig, footage: Footage, learned: Learned) -> Prior:
    """What was learned, as a prior for the region and the pictures that it was learned from; it is never stored."""
    meta = PriorMeta(
        camera="",
        roi=roi.id,
        created=_CREATED,
        polygon=roi.polygon,
        aspect=footage.width / footage.height,
        source="",
        frames=footage.count,
    )
    return Prior(meta, learned)
