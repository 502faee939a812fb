"""One zenoh session as the rest of the service sees it: no zenoh type shows."""

from __future__ import annotations

import atexit
import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol, Self, TypeVar

import zenoh
from zenoh import CongestionControl, Priority, ext
from zenoh.handlers import Callback as Direct

from service.bus import messages
from service.bus.errors import BusClosed, BusError
from service.bus.frames import FrameInbox, FramePublisher
from service.bus.link import Handle, reason, undeclares
from service.bus.messages import AliveCallback, Callback, Handler, Publisher, Reply
from service.bus.worker import Worker

_log = logging.getLogger(__name__)

_H = TypeVar("_H", bound=Handle)
_T = TypeVar("_T")

_CLOSE_S = 2.0
_ALARM_CACHE = 64
_ALARM_HEARTBEAT_S = 0.5


class Bus:
    """A session and all that was declared on it; made by `open_hub` and `open_client`.

    All methods raise BusClosed once the bus is closed and BusError for a key that is no key
    expression. Callbacks run one after another in a thread of their subscription, never in parallel
    with themselves; what they raise is logged. More than 4096 waiting messages of one subscription
    drop the oldest, with an error in the log.
    """

    def __init__(self, session: zenoh.Session, clock: str, endpoints: tuple[str, ...]) -> None:
        self.endpoints = endpoints
        """Where a client on this host reaches the hub: wildcard hosts and port 0 are resolved."""
        self._session = session
        self._clock = clock
        self._receivers: dict[Handle, None] = {}
        self._senders: dict[Handle, None] = {}
        self._lock = threading.Lock()
        self._closed = False
        self._values = Worker("last values")
        # A session with callbacks that is still open when the interpreter ends aborts the process.
        atexit.register(self._close_at_exit)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def close(self) -> None:
        """Close everything, receivers first; idempotent, returns within some 2 s.

        A frozen peer on a full connection makes zenoh itself wait some 10 s. That goes on behind the
        scenes, and the interpreter waits for its end: ending earlier would abort the process.
        """
        if not self._begin_close():
            return
        atexit.unregister(self._close_at_exit)
        closer = threading.Thread(target=self._shut, name="bus close", daemon=False)
        closer.start()
        closer.join(_CLOSE_S)
        if closer.is_alive():
            _log.warning("bus: a peer does not answer; still closing after %s s", _CLOSE_S)

    def frame_publisher(
        self, key: str, jpeg_key: str | None = None, jpeg_quality: int = 85
    ) -> FramePublisher:
        """A publisher of frames on `key`; where given, of JPEG pictures on `jpeg_key` on demand."""
        with self._declaring(key):
            frames = self._session.declare_publisher(key, congestion_control=CongestionControl.DROP)
            pictures = None
            if jpeg_key is not None:
                pictures = self._session.declare_publisher(
                    jpeg_key, congestion_control=CongestionControl.DROP, priority=Priority.DATA_LOW
                )
        publisher = FramePublisher(frames, pictures, self._clock, jpeg_quality)
        publisher.on_close(undeclares(frames), *([undeclares(pictures)] if pictures else []))
        return self._keep(publisher, self._senders)

    def frame_inbox(self, key: str) -> FrameInbox:
        """The newest frame of `key`."""
        inbox = FrameInbox(self._clock)
        with self._declaring(key):
            inbox.on_close(undeclares(self._session.declare_subscriber(key, _direct(inbox.receive))))
        return self._keep(inbox, self._receivers)

    def publisher(self, key: str) -> Publisher:
        """A publisher of small messages of which the latest counts: dropped where a receiver is slow.

        Late joiners get the last value, both those that `subscribe` with history (from the advanced
        publisher's cache) and those that `ask` (from a queryable: the cache does not answer plain
        queries).
        """
        with self._declaring(key):
            declared = ext.declare_advanced_publisher(
                self._session,
                key,
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=CongestionControl.DROP,
                priority=Priority.DATA,
                cache=ext.CacheConfig(1),
                publisher_detection=True,
            )
            publisher = Publisher(key, declared)
            queries = self._session.declare_queryable(key, _direct(_queue(self._values, publisher.answer)))
        publisher.on_close(undeclares(queries), undeclares(declared))
        return self._keep(publisher, self._senders)

    def alarm_publisher(self, key: str) -> Publisher:
        """A publisher of messages that must not be lost: cached for late joiners, repeated where missed."""
        with self._declaring(key):
            declared = ext.declare_advanced_publisher(
                self._session,
                key,
                encoding="application/cloudevents+json",
                congestion_control=CongestionControl.BLOCK,
                priority=Priority.INTERACTIVE_HIGH,
                express=True,
                cache=ext.CacheConfig(_ALARM_CACHE),
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=_ALARM_HEARTBEAT_S, sporadic_heartbeat=None
                ),
                publisher_detection=True,
            )
        publisher = Publisher(key, declared)
        publisher.on_close(undeclares(declared))
        return self._keep(publisher, self._senders)

    def subscribe(self, selector: str, callback: Callback, *, history: bool = False) -> Handle:
        """Call back with key and payload of each message; with `history` first with the last values."""
        with self._receiving(selector) as worker:
            deliver = _direct(_deliver(worker, callback))
            if not history:
                return self._received(worker, undeclares(self._session.declare_subscriber(selector, deliver)))
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                selector,
                deliver,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            )
            return self._received(worker, undeclares(subscriber))

    def subscribe_alarms(
        self, selector: str, callback: Callback, on_missed: Callable[[int], None] | None = None
    ) -> Handle:
        """Call back with key and payload of each alarm, in order, those before the subscription included.

        Alarms missed in an outage are fetched again; `on_missed` gets the number of those that could
        not be (more than 64 of one key).
        """
        with self._receiving(selector) as worker:
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                selector,
                _direct(_deliver(worker, callback)),
                history=ext.HistoryConfig(detect_late_publishers=True),
                recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
            )
            closers = [undeclares(subscriber)]
            if on_missed is not None:
                misses = subscriber.sample_miss_listener(_direct(_queue(worker, _count(on_missed))))
                closers.insert(0, undeclares(misses))
            return self._received(worker, *closers)

    def serve(self, key: str, handler: Handler) -> Handle:
        """Answer the queries of `key`; what the handler raises goes back as one line of error."""
        with self._receiving(key) as worker:
            queryable = self._session.declare_queryable(
                key, _direct(_queue(worker, partial(messages.answer, key, handler)))
            )
            return self._received(worker, undeclares(queryable))

    def ask(
        self,
        key: str,
        parameters: dict[str, str] | None = None,
        payload: bytes | None = None,
        timeout_s: float = 2.0,
    ) -> list[Reply]:
        """All replies to a query of a key or selector; empty when nobody serves it.

        One that does not answer in `timeout_s` is a reply with the error `Timeout`.
        """
        with self._declaring(key):
            replies = self._session.get(
                f"{key}?{messages.to_wire(parameters)}" if parameters else key,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout_s,
                payload=payload,
            )
            return [messages.to_reply(key, reply) for reply in replies]

    def alive(self, key: str) -> Handle:
        """A liveliness token: seen by others until it, or the bus, is closed, or the process dies."""
        token = Handle()
        with self._declaring(key):
            token.on_close(undeclares(self._session.liveliness().declare_token(key)))
        return self._keep(token, self._senders)

    def watch_alive(self, selector: str, callback: AliveCallback) -> Handle:
        """Call back with key and presence of each token, those that are there already included."""
        with self._receiving(selector) as worker:

            def submit(sample: zenoh.Sample) -> None:
                here = sample.kind == zenoh.SampleKind.PUT
                worker.submit(lambda: callback(str(sample.key_expr), here))

            watcher = self._session.liveliness().declare_subscriber(selector, _direct(submit), history=True)
            return self._received(worker, undeclares(watcher))

    def list_alive(self, selector: str, timeout_s: float = 2.0) -> list[str]:
        """The keys of the tokens that are there, sorted."""
        with self._declaring(selector):
            replies = self._session.liveliness().get(selector, timeout=timeout_s)
            return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    def _begin_close(self) -> bool:
        with self._lock:
            first, self._closed = not self._closed, True
        return first

    def _close_at_exit(self) -> None:
        if self._begin_close():
            self._shut()  # no thread can be started or waited for any more

    def _shut(self) -> None:
        for handle in [*self._receivers, *self._senders]:
            handle.close()
        self._values.close()
        with contextlib.suppress(zenoh.ZError):
            _close(self._session)

    @contextlib.contextmanager
    def _declaring(self, key: str) -> Iterator[None]:
        if self._closed:
            raise BusClosed(f"bus: closed, cannot use {key}")
        try:
            yield
        except zenoh.ZError as error:
            if self._closed:
                raise BusClosed(f"bus: closed, cannot use {key}") from error
            raise BusError(f"bus: {key}: {reason(error)}") from error

    @contextlib.contextmanager
    def _receiving(self, selector: str) -> Iterator[Worker]:
        with self._declaring(selector):
            worker = Worker(selector)
            try:
                yield worker
            except BaseException:
                worker.close()
                raise

    def _keep(self, handle: _H, among: dict[Handle, None]) -> _H:
        among[handle] = None
        handle.on_close(lambda: among.pop(handle, None))
        return handle

    def _received(self, worker: Worker, *closers: Callable[[], None]) -> Handle:
        subscription = Handle()
        subscription.on_close(*closers, worker.close)
        return self._keep(subscription, self._receivers)


class _Closeable(Protocol):
    def close(self) -> None: ...


def _close(session: _Closeable) -> None:
    session.close()


def _direct(callback: Callable[[_T], object]) -> Direct[_T]:
    """Run in the network thread: the callback must be as short as a swap or an append."""
    return Direct(callback, indirect=False)


def _queue(worker: Worker, job: Callable[[_T], None]) -> Callable[[_T], None]:
    return lambda item: worker.submit(partial(job, item))


def _count(on_missed: Callable[[int], None]) -> Callable[[ext.Miss], None]:
    return lambda miss: on_missed(miss.nb)


def _deliver(worker: Worker, callback: Callback) -> Callable[[zenoh.Sample], None]:
    def submit(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            worker.submit(lambda: callback(str(sample.key_expr), sample.payload.to_bytes()))

    return submit
