"""Numbered messages: once, in order, holes filled or told."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.bus.ordering import InOrder, Message, stamp, stamped

ONE, TWO = "0" * 16, "f" * 16


def message(number: int, publisher: str = ONE) -> Message:
    return Message("k", b"%d" % number, publisher, number)


class Kept:
    """What the publishers still have, and how often they were asked."""

    def __init__(self, *messages: Message) -> None:
        self.messages = list(messages)
        self.asked: list[str] = []

    def __call__(self, key: str) -> list[Message]:
        self.asked.append(key)
        return self.messages


def test_a_stamp_and_back() -> None:
    assert stamp(ONE, 12) == b"0000000000000000:12"
    assert stamped("k", b"p", stamp(ONE, 12)) == Message("k", b"p", ONE, 12)


@given(st.binary(max_size=40))
def test_any_other_attachment_is_of_an_unknown_publisher(attachment: bytes) -> None:
    assert stamped("k", b"p", b"x" + attachment) == Message("k", b"p")
    assert stamped("k", b"p", stamp(ONE, 1) + b"\n" + attachment) == Message("k", b"p")


def test_messages_in_order_pass_without_asking() -> None:
    kept = Kept()
    order = InOrder(kept)
    assert [order.due(message(n)) for n in range(3)] == [([message(n)], 0) for n in range(3)]
    assert kept.asked == ["k"]  # once, when the publisher was new


def test_duplicates_and_late_ones_are_dropped() -> None:
    order = InOrder(Kept())
    order.due(message(0))
    order.due(message(1))
    assert order.due(message(1)) == ([], 0)
    assert order.due(message(0)) == ([], 0)


def test_a_hole_is_filled_in_order_with_messages_of_the_same_publisher() -> None:
    kept = Kept()
    order = InOrder(kept)
    order.due(message(0))
    kept.messages = [message(3), message(0), message(2), message(2), message(1), message(5)]
    assert order.due(message(4)) == ([message(1), message(2), message(3), message(4)], 0)
    assert kept.asked == ["k", "k"]


def test_what_cannot_be_had_is_counted_once() -> None:
    kept = Kept()
    order = InOrder(kept)
    order.due(message(0))
    kept.messages = [message(8), message(9)]
    assert order.due(message(10)) == ([message(8), message(9), message(10)], 7)
    assert order.due(message(11)) == ([message(11)], 0)


def test_a_new_publisher_starts_with_what_it_has_and_has_lost_nothing() -> None:
    order = InOrder(Kept(message(6), message(7)))
    assert order.due(message(8)) == ([message(6), message(7), message(8)], 0)


def test_who_joins_late_gets_what_former_publishers_sent_first() -> None:
    order = InOrder(Kept(message(4, TWO), message(5, TWO), message(6), message(7)))
    expected = [message(4, TWO), message(5, TWO), message(6), message(7)]
    assert order.due(message(7)) == (expected, 0)
    assert order.catch_up("k") == ([], 0)


def test_who_was_there_all_along_gets_nothing_twice_from_a_new_publisher() -> None:
    kept = Kept()
    order = InOrder(kept)
    assert [order.due(message(n))[0] for n in (1, 2, 3)] == [[message(1)], [message(2)], [message(3)]]
    kept.messages = [message(2), message(3), message(4), message(5)]  # 4 and 5 were missed in an outage
    assert order.catch_up("k") == ([message(4), message(5)], 0)
    kept.messages.append(message(6, TWO))
    assert order.due(message(6, TWO)) == ([message(6, TWO)], 0)
    assert order.due(message(5)) == ([], 0)  # sent again under its old name after a crash


def test_unknown_publishers_pass_as_they_come() -> None:
    kept = Kept()
    order = InOrder(kept)
    plain = Message("k", b"p")
    assert [order.due(plain), order.due(plain)] == [([plain], 0), ([plain], 0)]
    assert kept.asked == []


@given(st.lists(st.integers(0, 30), min_size=1, max_size=60))
def test_any_arrival_gives_each_message_once_in_order_and_accounts_for_all(arrivals: list[int]) -> None:
    kept = Kept()
    order = InOrder(kept)
    out: list[int] = []
    lost = 0
    for number in [0, *arrivals]:
        kept.messages = [message(n) for n in range(max(0, number - 4), number + 1)]
        messages, more = order.due(message(number))
        out += [m.number for m in messages]
        lost += more
    assert out == sorted(set(out))
    assert len(out) + lost == max(arrivals) + 1


def test_a_forged_number_keeps_no_real_message_out() -> None:
    order = InOrder(Kept())
    order.due(message(0))
    forged = Message("k", b"forged", ONE, 999_999_999_999_999_998)
    assert order.due(forged) == ([forged], 0)  # shown, and nobody is told of a trillion lost ones
    for number in range(1, 11):
        assert order.due(message(number)) == ([message(number)], 0)


def test_a_forged_message_with_the_next_number_does_not_hide_the_real_one() -> None:
    order = InOrder(Kept())
    order.due(message(0))
    forged = Message("k", b"forged", ONE, 1)
    assert order.due(forged) == ([forged], 0)
    assert order.due(message(1)) == ([message(1)], 0)
    assert order.due(message(1)) == ([], 0)
    assert order.due(message(2)) == ([message(2)], 0)


def test_forged_publishers_do_not_grow_the_memory() -> None:
    order = InOrder(Kept())
    for n in range(5000):
        order.due(message(0, f"{n:016x}"))
    assert len(order._next) <= 4096
