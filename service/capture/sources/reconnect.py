"""A source that never gives up: it is opened again after every fault, with growing pauses."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, Iterator
from enum import StrEnum
from pathlib import Path
from threading import Event
from typing import Protocol

import numpy as np

from lumpwatch.service.capture.sources.base import Fault, Source, SourceError
from lumpwatch.service.config import BackoffConfig
from lumpwatch.service.core import Frame

_log = logging.getLogger(__name__)


class StreamState(StrEnum):
    """Where a reconnecting source stands."""

    CONNECTING = "connecting"
    """Opening, or open and waiting for the first frame."""
    RUNNING = "running"
    """Frames are coming."""
    WAITING = "waiting"
    """Pausing before the next attempt."""
    ENDED = "ended"
    """A finite source has been read to its end."""
    CLOSED = "closed"
    """Stopped for good."""


ALLOWED = {
    StreamState.CONNECTING: {StreamState.RUNNING, StreamState.WAITING, StreamState.ENDED, StreamState.CLOSED},
    StreamState.RUNNING: {StreamState.WAITING, StreamState.ENDED, StreamState.CLOSED},
    StreamState.WAITING: {StreamState.CONNECTING, StreamState.CLOSED},
    StreamState.ENDED: {StreamState.CLOSED},
    StreamState.CLOSED: set[StreamState](),
}


class Observer(Protocol):
    """Hears what happens to the connection; each attempt ends in `failed` or `connected`."""

    def attempt(self) -> None:
        """The source is about to be opened."""

    def connected(self) -> None:
        """The first frame of this connection has been read."""

    def failed(self, fault: Fault) -> None:
        """The attempt did not lead to a frame."""

    def dropped(self, reason: Fault) -> None:
        """A connection that had given frames has broken."""


def _without_urls(error: Exception) -> str:
    """Where an error arose: its text may hold the address with its password."""
    places = [f"{Path(at.filename).name}:{at.lineno}" for at in traceback.extract_tb(error.__traceback__)]
    return f"{type(error).__name__} at {' > '.join(places)}"


class Backoff:
    """Pauses that double from `initial_s` to `max_s`, with a share of `jitter` drawn at random."""

    def __init__(self, config: BackoffConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._pause_s = config.initial_s

    def reset(self) -> None:
        """Start again at `initial_s`."""
        self._pause_s = self._config.initial_s

    def next(self) -> float:
        """Seconds to wait now: within [1 - jitter, 1] of the undrawn pause."""
        pause = self._pause_s * (1 - self._config.jitter * self._rng.random())
        self._pause_s = min(2 * self._pause_s, self._config.max_s)
        return pause


class Reconnecting:
    """Reads a source for ever; `stop` ends it from another thread.

    Whatever the source raises is a fault; what is none of its own counts as `unexpected`. A change of picture
    size is reported like any fault; the source accepts the new size when it is opened again.
    Not thread-safe but for `stop` and `state`.
    """

    def __init__(
        self,
        source: Source,
        backoff: BackoffConfig,
        stop: Event,
        observer: Observer,
        rng: np.random.Generator,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        """`sleep` is how a pause is spent; the default is `stop.wait`, which ends it at once."""
        self._source = source
        self._backoff = Backoff(backoff, rng)
        self._stop = stop
        self._observer = observer
        self._sleep = sleep or stop.wait
        self._state = StreamState.CONNECTING
        self._open = False
        self._logged: Fault | None = None

    @property
    def state(self) -> StreamState:
        """Where the source stands."""
        return self._state

    def __iter__(self) -> Iterator[Frame]:
        """Frames until the end of a finite source or until stopped."""
        while frame := self.read():
            yield frame

    def read(self) -> Frame | None:
        """The next frame, after as many attempts as it takes; None once ENDED or CLOSED."""
        while self._state not in (StreamState.ENDED, StreamState.CLOSED):
            if self._stop.is_set():
                self.close()
                break
            try:
                if not self._open:
                    self._connect()
                frame = self._source.read()
            except SourceError as error:
                self._fail(error)
                continue
            except Exception as error:  # what a camera sends is anything: it must not end the process
                if self._logged is not Fault.UNEXPECTED:
                    _log.error("reading failed: %s", _without_urls(error))
                self._fail(SourceError(Fault.UNEXPECTED, f"reading failed ({type(error).__name__})"))
                continue
            if frame is None:
                self._source.close()
                self._go(StreamState.ENDED)
                break
            if self._state is StreamState.CONNECTING:
                self._run()
            return frame
        return None

    def close(self) -> None:
        """Release the source for good; idempotent."""
        self._source.close()
        if self._state is not StreamState.CLOSED:
            self._go(StreamState.CLOSED)

    def _connect(self) -> None:
        if self._state is StreamState.WAITING:
            self._go(StreamState.CONNECTING)
        self._observer.attempt()
        self._source.open()
        self._open = True

    def _run(self) -> None:
        self._go(StreamState.RUNNING)
        self._backoff.reset()
        self._observer.connected()
        if self._logged:
            _log.info("frames again after %s", self._logged)
            self._logged = None

    def _fail(self, error: SourceError) -> None:
        self._source.close()
        self._open = False
        if self._state is StreamState.RUNNING:
            self._observer.dropped(error.fault)
        else:
            self._observer.failed(error.fault)
        if error.fault is not self._logged:
            _log.warning("%s", error)
            self._logged = error.fault
        self._go(StreamState.WAITING)
        self._sleep(self._backoff.next())

    def _go(self, state: StreamState) -> None:
        if state not in ALLOWED[self._state]:
            raise RuntimeError(f"a stream cannot go from {self._state} to {state}")
        self._state = state
