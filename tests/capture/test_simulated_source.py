"""The simulated feed as a source of frames."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.service.capture.sources.simulated import SimulatedSource
from lumpwatch.service.config.source import SourceConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec

SMALL = "width=160&height=120"


class Clock:
    """A monotonic clock that only sleeping moves, and a wall clock 1000 s ahead of it."""

    def __init__(self) -> None:
        self.now = 50.0
        self.slept: list[float] = []

    def monotonic(self) -> float:
        return self.now

    def wall(self) -> float:
        return self.now + 1000.0

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


def make(clock: Clock, query: str = "", **config: object) -> SimulatedSource:
    url = f"sim:feed?{SMALL}{query}"
    return SimulatedSource(
        SourceConfig.model_validate({"url": url, **config}), "cam", clock.monotonic, clock.wall, clock.sleep
    )


def take(source: SimulatedSource) -> Frame:
    frame = source.read()
    assert frame is not None
    return frame


def test_frames_come_at_the_stated_rate() -> None:
    clock = Clock()
    source = make(clock, fps=8.0)
    source.open()
    frames = [take(source) for _ in range(5)]
    assert [f.seq for f in frames] == [0, 1, 2, 3, 4]
    assert [f.capture_s for f in frames] == pytest.approx([50 + i / 8 for i in range(5)])
    assert [f.received_s for f in frames] == [f.capture_s for f in frames]
    assert [f.wall_s for f in frames] == [f.received_s + 1000 for f in frames]
    assert clock.slept == pytest.approx([1 / 8] * 4)
    assert source.nominal_fps == 8.0
    assert source.length is None


def test_a_late_reader_gets_the_present_picture() -> None:
    clock = Clock()
    source = make(clock, fps=10.0)
    source.open()
    take(source)
    clock.now = 50.0 + 3.52
    late = take(source)
    assert late.capture_s == pytest.approx(53.5)
    assert late.seq == 1
    reference = FeedSimulator(FeedSpec.from_query(SMALL, fps=10.0))
    reference.skip(35)
    np.testing.assert_array_equal(late.data, reference.render()[0])
    assert take(source).capture_s == pytest.approx(53.6)


def test_a_reader_that_is_late_by_less_than_a_frame_misses_none() -> None:
    clock = Clock()
    source = make(clock, fps=10.0)
    source.open()
    captured = []
    for _ in range(5):
        captured.append(take(source).capture_s)
        clock.now += 0.09
    assert captured == pytest.approx([50.0, 50.1, 50.2, 50.3, 50.4])


def test_unpaced_frames_do_not_wait() -> None:
    clock = Clock()
    source = make(clock, "&seconds=2", fps=10.0, pace=False)
    source.open()
    assert source.length == 20
    frames = [take(source) for _ in range(20)]
    assert source.read() is None
    assert source.read() is None
    assert clock.slept == []
    assert np.diff([f.capture_s for f in frames]) == pytest.approx(0.1)


def test_a_paced_finite_feed_ends_even_for_a_late_reader() -> None:
    clock = Clock()
    source = make(clock, "&seconds=2")
    source.open()
    take(source)
    clock.now += 60
    assert source.read() is None


def test_fps_and_seed_of_the_configuration_win() -> None:
    clock = Clock()
    query = "&fps=5&seed=3"
    assert make(clock, query).nominal_fps == 5.0
    assert make(clock, query, fps=20.0).nominal_fps == 20.0
    pictures = {}
    for name, config in (("query", {}), ("config", {"seed": 4}), ("zero", {"seed": 0})):
        source = make(clock, query, pace=False, **config)
        source.open()
        pictures[name] = take(source).data
    for name, seed in (("query", 3), ("config", 4), ("zero", 0)):
        expected, _ = FeedSimulator(FeedSpec.from_query(SMALL, fps=5.0, seed=seed)).render()
        np.testing.assert_array_equal(pictures[name], expected)


@pytest.mark.parametrize(
    ("gray", "encoding", "shape"), [("true", "gray8", (120, 160)), ("false", "bgr8", (120, 160, 3))]
)
def test_encodings(gray: str, encoding: str, shape: tuple[int, ...]) -> None:
    source = make(Clock(), f"&gray={gray}")
    source.open()
    frame = take(source)
    assert (frame.encoding, frame.data.shape, frame.width, frame.height) == (encoding, shape, 160, 120)
    assert frame.window == (0, 0, 160, 120)


def test_opened_again_the_feed_begins_anew_and_counting_goes_on() -> None:
    clock = Clock()
    source = make(clock, "&seconds=0.2", fps=10.0)
    source.open()
    first = [take(source), take(source)]
    assert source.read() is None
    source.close()
    source.close()
    clock.now = 80.0
    source.open()
    again = take(source)
    assert (again.seq, again.capture_s) == (2, 80.0)
    np.testing.assert_array_equal(again.data, first[0].data)


def test_reading_before_opening_is_refused() -> None:
    source = make(Clock())
    source.close()
    with pytest.raises(RuntimeError, match="before open"):
        source.read()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("sim:mill", "unknown simulation 'sim:mill', expected sim:feed"),
        ("sim:feed?lumps=3", "camera cam: sim:feed: lumps: unknown key"),
        ("sim:feed?dust=9", "camera cam: sim:feed: dust: "),
    ],
)
def test_a_bad_url_is_refused_by_name(url: str, words: str) -> None:
    clock = Clock()
    with pytest.raises(ConfigError) as caught:
        SimulatedSource(
            SourceConfig.model_validate({"url": url}), "cam", clock.monotonic, clock.wall, clock.sleep
        )
    assert words in str(caught.value)
