"""One zenoh session as the rest of the service sees it: no zenoh type shows."""

from __future__ import annotations

import atexit
import contextlib
import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Self, TypeVar

import zenoh
from zenoh import CongestionControl, Priority, ext

from lumpwatch.service.bus.callback_queue import Worker
from lumpwatch.service.bus.cut_off import CutOff
from lumpwatch.service.bus.endpoints import (
    ALARMS_KEPT,
    Callback,
    Handler,
    Publisher,
    Reply,
    answer,
    declare_alarms,
    declare_state,
    to_message,
    to_reply,
    to_wire,
)
from lumpwatch.service.bus.errors import BusClosed, BusError
from lumpwatch.service.bus.frames import FrameInbox, FramePublisher
from lumpwatch.service.bus.handles import Handle, direct, queue, reason, shut, undeclares
from lumpwatch.service.bus.ordering import InOrder, Message
from lumpwatch.service.bus.services import Lanes, Service
from lumpwatch.service.bus.subscriptions import declare_alarm_subscriber, declare_subscriber

_log = logging.getLogger(__name__)

_H = TypeVar("_H", bound=Handle)

_CLOSE_S = 2.0
_RECENT_S = 2.0
ALARMS_WAITING = 1024
"""How many alarms wait at the most while a hub does not take them; the event log has them all."""
_LAST_ALARMS_S = 0.5


class Bus:
    """A session and all that was declared on it; made by `open_hub` and `open_client`.

    All methods raise BusClosed once the bus is closed and BusError for a key that is no key
    expression. Callbacks run one after another in a thread of their subscription, never in parallel
    with themselves; what they raise is logged. More than 4096 waiting messages of one subscription
    drop the oldest, with an error in the log.
    """

    def __init__(
        self,
        session: zenoh.Session,
        clock: str,
        endpoints: tuple[str, ...],
        cut_off: Callable[[], tuple[CutOff, ...]] = tuple,
    ) -> None:
        """`cut_off` cuts sessions off; a hub has it."""
        self.endpoints = endpoints
        """Where a client on this host reaches the hub: wildcard hosts and port 0 are resolved."""
        self._cut_off = cut_off
        self._session = session
        self._clock = clock
        self._receivers: dict[Handle, None] = {}
        self._senders: dict[Handle, None] = {}
        self._lock = threading.Lock()
        self._closed = False
        self._values = Worker("last values")
        # Alarms may wait for slow receivers, states never do: neither holds up the other, nor who decides.
        self._alarms = Worker("alarms", ALARMS_WAITING)
        self._states = Worker("states")
        self._lanes = Lanes(self._values)
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

    @property
    def connected(self) -> bool:
        """Whether this client reaches a hub now; one that froze counts as reached for some 10 s."""
        return not self._closed and bool(self._session.info.routers_zid())

    def cut_off(self) -> tuple[CutOff, ...]:
        """Cut off who burdens a hub; those of whom that was not said yet. To be called ten times a second."""
        return () if self._closed else self._cut_off()

    @property
    def flushed(self) -> bool:
        """Whether all alarms that were put have left this process."""
        return self._alarms.idle

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
            inbox.on_close(undeclares(self._session.declare_subscriber(key, direct(inbox.receive))))
        return self._keep(inbox, self._receivers)

    def publisher(self, key: str) -> Publisher:
        """A publisher of small messages of which the latest counts: dropped where a receiver is slow.

        Late joiners get the last value, both those that `subscribe` with history (from the advanced
        publisher's cache) and those that `ask` (from a queryable: the cache does not answer plain
        queries).
        """
        return self._published(Publisher(key, 1, self._states), key, declare_state)

    def alarm_publisher(self, key: str, kept: Sequence[Message] = ()) -> Publisher:
        """A publisher of messages that must not be lost: repeated where missed, the last 64 kept.

        Late joiners get those with `subscribe_alarms` or `ask`, after `kept`: messages of former
        publishers of the key, which nobody gets twice.
        """
        return self._published(Publisher(key, ALARMS_KEPT, self._alarms, kept), key, declare_alarms)

    def subscribe(self, selector: str, callback: Callback, *, history: bool = False) -> Handle:
        """Call back with key and payload of each message; with `history` first with the last values."""
        with self._receiving(selector) as worker:
            return self._received(
                worker, declare_subscriber(self._session, selector, worker, callback, history)
            )

    def subscribe_others(self, key: str, name: str, callback: Callable[[str], None]) -> Handle:
        """Call back with the name of each publisher but `name` that sends on a key; empty where it has none."""

        def pass_on(sample: zenoh.Sample) -> None:
            if (publisher := to_message(sample).publisher) != name:
                callback(publisher)

        with self._receiving(key) as worker:
            subscriber = self._session.declare_subscriber(key, direct(queue(worker, pass_on)))
            return self._received(worker, undeclares(subscriber))

    def subscribe_alarms(
        self, selector: str, callback: Callback, on_missed: Callable[[int], None] | None = None
    ) -> Handle:
        """Call back with key and payload of each alarm, once and in order, what is kept of old ones first.

        That holds over restarts of the publisher too, where it keeps what its predecessors sent.

        Alarms missed in an outage are fetched again; `on_missed` gets the number of those that could
        not be (more than 64 of one publisher).
        """
        order = InOrder(self._recent)
        with self._receiving(selector) as worker:
            closers = declare_alarm_subscriber(self._session, selector, worker, order, callback, on_missed)
            return self._received(worker, *closers)

    def serve(self, key: str, handler: Handler) -> Handle:
        """Answer the queries of `key`; what the handler raises goes back as one line of error."""
        with self._receiving(key) as worker:
            queryable = self._session.declare_queryable(
                key, direct(queue(worker, partial(answer, key, handler)))
            )
            return self._received(worker, undeclares(queryable))

    def serve_all(self, prefix: str, services: Mapping[str, Service]) -> Handle:
        """Answer the queries of `prefix`/NAME for each named service, with one queryable for all of them.

        The last part of the key that was asked names the service; it must be spelt out there, while the
        parts before it may be wildcards. Other queries below `prefix` get no answer from here.
        """
        with self._declaring(prefix):
            queryable = self._session.declare_queryable(
                f"{prefix}/*", direct(self._lanes.dispatcher(prefix, services))
            )
        served = Handle()
        served.on_close(undeclares(queryable))
        return self._keep(served, self._receivers)

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
            replies = self._get(f"{key}?{to_wire(parameters)}" if parameters else key, payload, timeout_s)
            return [to_reply(key, reply) for reply in replies]

    def alive(self, key: str) -> Handle:
        """A liveliness token: seen by others until it, or the bus, is closed, or the process dies."""
        token = Handle()
        with self._declaring(key):
            token.on_close(undeclares(self._session.liveliness().declare_token(key)))
        return self._keep(token, self._senders)

    def watch_alive(self, selector: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call back with the key of each liveliness token that is there, comes (True) or goes (False)."""

        def pass_on(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        with self._receiving(selector) as worker:
            subscriber = self._session.liveliness().declare_subscriber(
                selector, direct(queue(worker, pass_on)), history=True
            )
            return self._received(worker, undeclares(subscriber))

    def _begin_close(self) -> bool:
        with self._lock:
            first, self._closed = not self._closed, True
        return first

    def _close_at_exit(self) -> None:
        if self._begin_close():
            self._shut()  # no thread can be started or waited for any more

    def _shut(self) -> None:
        for handle in list(self._receivers):
            handle.close()
        self._alarms.drain(_LAST_ALARMS_S)
        for handle in list(self._senders):
            handle.close()
        for worker in (self._values, self._alarms, self._states):
            worker.close()
        self._lanes.close()
        with contextlib.suppress(zenoh.ZError):
            shut(self._session)

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

    def _published(
        self,
        publisher: Publisher,
        key: str,
        declare: Callable[[zenoh.Session, str], ext.AdvancedPublisher],
    ) -> Publisher:
        with self._declaring(key):
            # Who hears of the publisher asks for what it keeps: the answer must be there first.
            queries = self._session.declare_queryable(key, direct(queue(self._values, publisher.answer)))
            publisher.on_close(undeclares(queries))
            declared = declare(self._session, key)
            publisher.use(declared)
            publisher.on_close(undeclares(declared))
        return self._keep(publisher, self._senders)

    def _get(self, selector: str, payload: bytes | None, timeout_s: float) -> Iterable[zenoh.Reply]:
        return self._session.get(
            selector,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            payload=payload,
        )

    def _recent(self, key: str) -> list[Message]:
        with contextlib.suppress(zenoh.ZError):
            replies = self._get(key, None, _RECENT_S)
            return [to_message(reply.ok) for reply in replies if reply.ok is not None]
        return []

    def _received(self, worker: Worker, *closers: Callable[[], None]) -> Handle:
        subscription = Handle()
        subscription.on_close(*closers, worker.close)
        return self._keep(subscription, self._receivers)
