"""Cameras and their regions of interest."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from lumpwatch.service.config.alarm import AlarmConfig, BlockedAlarmConfig
from lumpwatch.service.config.base import Id, PositiveSeconds, Strict, Unit, kind_or
from lumpwatch.service.config.calibration import CalibrationConfig
from lumpwatch.service.config.detector import DetectorConfig
from lumpwatch.service.config.feed import FeedConfig, MouthConfig
from lumpwatch.service.config.jdt import JdtConfig
from lumpwatch.service.config.learning import LearningConfig
from lumpwatch.service.config.proof import ProofTestConfig
from lumpwatch.service.config.quality import QualityConfig
from lumpwatch.service.config.sight import SightConfig
from lumpwatch.service.config.source import SourceConfig

Point = tuple[Unit, Unit]
DecideRate = Annotated[float, Field(ge=1.0, le=240.0)] | Literal["all"]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)]


def _cross(o: Point, a: Point, b: Point) -> float:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def _goes_back(a: Point, b: Point, c: Point) -> bool:
    """Whether the way a -> b -> c turns round on the same line."""
    forward = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return _cross(a, b, c) == 0.0 and forward < 0.0


def _on(a: Point, b: Point, p: Point) -> bool:
    """Whether p, which lies on the line through a and b, lies between them."""
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def _segments_meet(p1: Point, p2: Point, q1: Point, q2: Point) -> bool:
    """Whether two edges cross or touch."""
    d1, d2 = _cross(q1, q2, p1), _cross(q1, q2, p2)
    d3, d4 = _cross(p1, p2, q1), _cross(p1, p2, q2)
    if d1 * d2 < 0 and d3 * d4 < 0:
        return True
    touching = ((d1, q1, q2, p1), (d2, q1, q2, p2), (d3, p1, p2, q1), (d4, p1, p2, q2))
    return any(d == 0.0 and _on(a, b, p) for d, a, b, p in touching)


def polygon_area(polygon: tuple[Point, ...]) -> float:
    """Area by the shoelace formula, in units of the picture's area."""
    rolled = polygon[1:] + polygon[:1]
    return abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(polygon, rolled, strict=True))) / 2


_FEED_OF_MOUTH = ("signal_tolerance", "signal_for_s")
"""The plant may tell a mouth itself what its feed does."""


LUMP_ALARM = {"raise_above": 0.999, "on_delay_s": 0.5}
"""Defaults of the alarm where the likelihood is the lump's. Its evidence comes from one body and frames much alike, so
existence runs ahead of what is known: what soon passes 0.9 may be ore, what stays above 0.999 is seldom any."""


class RoiConfig(Strict):
    """One region of interest: where to look, how, and when to raise the alarm."""

    id: Id
    """Name of the ROI, unique in its camera."""
    polygon: Polygon
    """Corners relative to the picture: (0, 0) top left, (1, 1) bottom right."""
    watch: Literal["belt", "mouth"] = "belt"
    """`belt`: lumps on the feed; `mouth`: whether material stands in the crusher's mouth or a chute. For a mouth there
    is no `detector`, `calibration` or `learning`, and no key of the lump alarm: its alarm is `alarm.blocked`."""
    mouth: MouthConfig = MouthConfig()
    """With `watch: mouth`: when it is blocked."""
    detector: DetectorConfig = JdtConfig()
    """The filter that runs on this ROI."""
    decide_hz: DecideRate | None = None
    """Frames a second that are decided on, or `all`: every second, third … one of the camera's, as few as are no fewer
    than this. Those between are passed over by rule, and counted as `paced`. Left out: 10, more on a calibrated belt
    whose `speed_m_s` leaves a lump's ride too short for that; all frames for trackers, for networks, and where
    `evidence` is configured, which reads by frames and not by seconds."""
    calibration: CalibrationConfig | None = None
    """Where the belt lies, for sizes in millimetres; left out: sizes are judged by what training saw."""
    feed: FeedConfig = FeedConfig()
    """Whether the feed runs, stands or is empty."""
    alarm: AlarmConfig = AlarmConfig()
    """Thresholds and delays of the alarm."""
    proof_test: ProofTestConfig = ProofTestConfig()
    """When the ROI is tested with a synthetic lump."""
    learning: LearningConfig = LearningConfig()
    """Refining the prior while the daemon runs."""

    @model_validator(mode="before")
    @classmethod
    def _surer_of_lumps(cls, given: Any) -> Any:
        """What the alarm has of its own where the likelihood is the lump's, unless the configuration says otherwise."""
        if not isinstance(given, dict) or given.get("watch", "belt") != "belt":
            return given
        alarm = given.get("alarm", {})
        if isinstance(alarm, dict) and _likelihood_of(given.get("detector", {})) == "lump":
            return {**given, "alarm": {**LUMP_ALARM, **alarm}}
        return given

    @property
    def watches_mouth(self) -> bool:
        """Whether it is the second kind of region."""
        return self.watch == "mouth"

    @property
    def working_size_px(self) -> int:
        """Longer side of the working picture."""
        return self.mouth.working_size_px if self.watches_mouth else self.detector.working_size_px

    @model_validator(mode="after")
    def _fits_what_it_watches(self) -> Self:
        if not self.watches_mouth:
            if self.mouth != MouthConfig():
                raise ValueError("mouth: belongs to a roi with `watch: mouth`; this one watches a belt")
            if self.alarm.blocked != BlockedAlarmConfig():
                raise ValueError(
                    "alarm.blocked: belongs to a roi with `watch: mouth`; this one watches a belt"
                )
            return self
        for key, given in (
            ("detector", self.detector != JdtConfig()),
            ("calibration", self.calibration is not None),
            ("learning", self.learning != LearningConfig()),
        ):
            if given:
                raise ValueError(
                    f"{key}: does not fit `watch: mouth`, which looks for no lumps; leave it out"
                )
        lumps = {key: value for key, value in self.alarm if key not in ("blind", "system", "blocked")}
        for key, value in lumps.items():
            if value != AlarmConfig.model_fields[key].default:
                raise ValueError(
                    f"alarm.{key}: is of the lump alarm, which a roi with `watch: mouth` does not have; "
                    f"the alarm of a mouth is set under alarm.blocked"
                )
        if self.proof_test.least_warning_s != ProofTestConfig().least_warning_s:
            raise ValueError(
                "proof_test.least_warning_s: does not fit `watch: mouth`: nothing comes to a lip there"
            )
        for key, value in self.feed:
            if key not in _FEED_OF_MOUTH and value != FeedConfig.model_fields[key].default:
                raise ValueError(
                    f"feed.{key}: does not fit `watch: mouth`: the feed is seen on the belt, by the roi of mouth.belt"
                )
        return self

    @field_validator("polygon")
    @classmethod
    def _simple(cls, polygon: tuple[Point, ...]) -> tuple[Point, ...]:
        n = len(polygon)
        for i in range(n):
            for j in range(i + 1, n):
                if polygon[i] == polygon[j]:
                    raise ValueError(f"corners {i + 1} and {j + 1} are the same point")
            after = polygon[(i + 1) % n], polygon[(i + 2) % n]
            if _goes_back(polygon[i], *after):
                raise ValueError(f"the polygon goes back on itself at corner {(i + 1) % n + 1}")
            for j in range(i + 2, n):
                if (j + 1) % n == i:
                    continue
                if _segments_meet(polygon[i], polygon[i + 1], polygon[j], polygon[(j + 1) % n]):
                    raise ValueError(f"the polygon crosses itself (edges {i + 1} and {j + 1})")
        if polygon_area(polygon) < 1e-4:
            raise ValueError("the polygon covers less than 0.01 % of the picture")
        return polygon


class WireConfig(Strict):
    """How a camera's frames travel on the bus."""

    encoding: Literal["raw", "jpeg"] = "raw"
    """`raw` planes (shared memory on one host), or `jpeg` for a monitor on another host."""
    jpeg_quality: int = Field(default=85, ge=10, le=100)
    """Quality of JPEG frames."""


class LatencyConfig(Strict):
    """How late a decision may be."""

    budget_s: PositiveSeconds = 1.0
    """Seconds from capture to publication that leave the operator enough time."""
    for_s: PositiveSeconds = 5.0
    """When every decision of so long came later, the system alarm of the ROI says so."""


class CameraConfig(Strict):
    """One camera with its regions of interest."""

    id: Id
    """Name of the camera, unique in the site."""
    source: SourceConfig
    """Where the frames come from."""
    rois: Annotated[tuple[RoiConfig, ...], Field(min_length=1, max_length=32)]
    """Regions of interest."""
    wire: WireConfig = WireConfig()
    """How frames travel on the bus."""
    blind_after_s: PositiveSeconds = 3.0
    """A ROI without a fresh frame for this long is BLIND."""
    latency: LatencyConfig = LatencyConfig()
    """How late a decision may be before that is an alarm of its own."""
    sight: SightConfig = SightConfig()
    """How many judged frames CLEAR needs."""
    quality: QualityConfig = QualityConfig()
    """Whether the picture is fit to judge."""

    @model_validator(mode="after")
    def _unique(self) -> Self:
        ids = [roi.id for roi in self.rois]
        if twice := {i for i in ids if ids.count(i) > 1}:
            raise ValueError(f"rois: id '{min(twice)}' is given more than once")
        least_hz = self.sight.least_frames / self.sight.within_s
        for roi in self.rois:
            if isinstance(roi.decide_hz, float) and roi.decide_hz <= least_hz:
                raise ValueError(
                    f"roi {roi.id}: decide_hz ({roi.decide_hz:g}) is too seldom for CLEAR, which takes more than "
                    f"{least_hz:g} frames a second (sight.least_frames within sight.within_s)"
                )
        for roi in self.rois:
            belt = roi.mouth.belt
            if belt is None:
                continue
            if belt not in ids:
                known = ", ".join(other.id for other in self.rois if not other.watches_mouth) or "none"
                raise ValueError(
                    f"rois: roi '{roi.id}': mouth.belt: '{belt}' is no roi of this camera that watches a belt "
                    f"(there are: {known})"
                )
            if self.roi(belt).watches_mouth:
                raise ValueError(
                    f"rois: roi '{roi.id}': mouth.belt: '{belt}' watches a mouth, expected a roi that watches a belt"
                )
            if not self.roi(belt).feed.enabled:
                raise ValueError(
                    f"rois: roi '{roi.id}': mouth.belt: the feed of '{belt}' is not looked at (feed.enabled)"
                )
        return self

    @property
    def needs_colour(self) -> bool:
        """Whether any ROI looks at colour; if none does, only luma is cut, sent and filtered."""
        return any(roi.detector.needs_colour for roi in self.rois)

    def roi(self, roi_id: str) -> RoiConfig:
        """The ROI of that id; KeyError where there is none."""
        for roi in self.rois:
            if roi.id == roi_id:
                return roi
        raise KeyError(roi_id)


def _likelihood_of(detector: Any) -> Any:
    """Kind of the likelihood of a detector as it was given; None for a tracker, and for what is no detector."""
    if kind_or("jdt")(detector) != "jdt":
        return None
    likelihood = detector.get("likelihood", {}) if isinstance(detector, dict) else detector.likelihood
    return kind_or("lump")(likelihood)
