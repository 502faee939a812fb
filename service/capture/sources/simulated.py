"""The simulated feed as a source: `sim:feed` or `sim:feed?lumps_per_minute=8&dust=0.5`."""

from __future__ import annotations

from collections.abc import Callable

from lumpwatch.service.config import SourceConfig
from lumpwatch.service.core import Frame
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.simulator import FeedSimulator, FeedSpec


class SimulatedSource:
    """Frames of a FeedSimulator, gray8 or, with gray=false in the query, bgr8.

    `fps` and `seed` of the configuration go before those of the query. Frame i of the feed is
    captured at start + i / fps. When paced, a reader that is late by more than a frame gets the
    present one; those between are passed over. Finite where the query gives `seconds`; opened again,
    the feed begins anew. The constructor raises ConfigError.
    """

    def __init__(
        self,
        config: SourceConfig,
        camera_id: str,
        monotonic: Callable[[], float],
        wall: Callable[[], float],
        sleep: Callable[[float], object],
    ) -> None:
        self._pace = config.pace
        self._monotonic, self._wall, self._sleep = monotonic, wall, sleep
        self._spec = spec_of(config, camera_id)
        self._simulator: FeedSimulator | None = None
        self._start_s = 0.0
        self._index = 0
        self._seq = 0

    def open(self) -> None:
        """Begin the feed."""
        self._simulator = FeedSimulator(self._spec)
        self._index = 0
        self._start_s = self._monotonic()

    def read(self) -> Frame | None:
        """The next frame; None at the end of a feed with `seconds`."""
        simulator, spec = self._simulator, self._spec
        if simulator is None:
            raise RuntimeError("read before open")
        if self._pace:
            late = int((self._monotonic() - self._start_s) * spec.fps) - self._index
            if late > 1:
                simulator.skip(late)
                self._index += late
        if self.length is not None and self._index >= self.length:
            return None
        picture, _ = simulator.render()
        capture_s = self._start_s + self._index / spec.fps
        if self._pace and (wait := capture_s - self._monotonic()) > 0:
            self._sleep(wait)
        frame = Frame(
            seq=self._seq,
            capture_s=capture_s,
            received_s=self._monotonic(),
            wall_s=self._wall(),
            width=spec.width,
            height=spec.height,
            encoding="gray8" if spec.gray else "bgr8",
            data=picture,
        )
        self._index += 1
        self._seq += 1
        return frame

    def close(self) -> None:
        """Drop the feed; idempotent."""
        self._simulator = None

    @property
    def nominal_fps(self) -> float | None:
        """Frames a second."""
        return self._spec.fps

    @property
    def length(self) -> int | None:
        """Number of frames where the query gives `seconds`."""
        return None if self._spec.seconds is None else max(round(self._spec.seconds * self._spec.fps), 1)


def spec_of(config: SourceConfig, camera_id: str) -> FeedSpec:
    """What the camera's URL asks to be simulated. Raises ConfigError for what there is not."""
    name, _, query = config.url.get_secret_value().partition("?")
    if name != "sim:feed":
        raise ConfigError(f"camera {camera_id}: url: unknown simulation '{name}', expected sim:feed")
    overrides: dict[str, object] = {}
    if config.fps is not None:
        overrides["fps"] = config.fps
    if "seed" in config.model_fields_set:
        overrides["seed"] = config.seed
    try:
        return FeedSpec.from_query(query, **overrides)
    except ConfigError as error:
        raise ConfigError(f"camera {camera_id}: {error}") from error
