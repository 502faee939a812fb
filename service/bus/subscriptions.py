"""Subscriptions: of messages of which the latest counts, and of alarms, none of which may be lost."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import zenoh
from zenoh import ext

from lumpwatch.service.bus.callback_queue import Worker
from lumpwatch.service.bus.endpoints import ALARMS_KEPT, Callback, to_message
from lumpwatch.service.bus.handles import direct, queue, undeclares
from lumpwatch.service.bus.ordering import Due, InOrder

Closer = Callable[[], None]
"""Takes back what was declared."""


def declare_subscriber(
    session: zenoh.Session, selector: str, worker: Worker, callback: Callback, history: bool
) -> Closer:
    """Call back with key and payload of each message; with `history` first with the last values."""

    def pass_on(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            callback(str(sample.key_expr), sample.payload.to_bytes())

    deliver = direct(queue(worker, pass_on))
    if not history:
        return undeclares(session.declare_subscriber(selector, deliver))
    subscriber = ext.declare_advanced_subscriber(
        session,
        selector,
        deliver,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    return undeclares(subscriber)


def declare_alarm_subscriber(
    session: zenoh.Session,
    selector: str,
    worker: Worker,
    order: InOrder,
    callback: Callback,
    on_missed: Callable[[int], None] | None,
) -> tuple[Closer, Closer]:
    """Call back with key and payload of each alarm as `order` has it; `on_missed` gets the number of lost ones."""

    def pass_on(due: Due) -> None:
        messages, lost = due
        if lost and on_missed is not None:
            worker.guard(partial(on_missed, lost))
        for message in messages:
            worker.guard(partial(callback, message.key, message.payload))

    def arrived(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            pass_on(order.due(to_message(sample)))

    def appeared(sample: zenoh.Sample) -> None:
        """A publisher is there: what it keeps of itself and its predecessors may be news."""
        if sample.kind == zenoh.SampleKind.PUT:
            pass_on(order.catch_up(str(sample.key_expr).partition("/@adv/")[0]))

    subscriber = ext.declare_advanced_subscriber(
        session,
        selector,
        direct(queue(worker, arrived)),
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=ALARMS_KEPT),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )
    publishers = subscriber.detect_publishers(direct(queue(worker, appeared)), history=True)
    return undeclares(publishers), undeclares(subscriber)
