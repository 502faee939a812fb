"""The keys of the bus: spelt out, and back to their parts."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from zenoh import KeyExpr

from lumpwatch.service.bus.keys import KEY_OF, Address, Keys, Kind, on_every_site, parse

names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}", fullmatch=True)
PARTS = ["s", "c", "r", "frame", "jpeg", "state", "ack", "@alive", "heartbeat", "*", ""]
BAD_NAMES = ["", "a/b", "*", "**", "a*", "@alive", "a#", "a?b", "-a", "a" * 64, "a b", "ä", "a\n", "$*"]


def test_keys_are_those_of_the_contract() -> None:
    keys = Keys("north-pit")
    assert keys.frame("c1") == "lumpwatch/v1/north-pit/c1/frame"
    assert keys.jpeg("c1") == "lumpwatch/v1/north-pit/c1/frame/jpeg"
    assert keys.heartbeat("c1") == "lumpwatch/v1/north-pit/c1/heartbeat"
    assert keys.state("c1", "apron") == "lumpwatch/v1/north-pit/c1/apron/state"
    assert keys.alarm("c1", "apron") == "lumpwatch/v1/north-pit/c1/apron/alarm"
    assert keys.command("c1", "apron", "ack") == "lumpwatch/v1/north-pit/c1/apron/ack"
    assert keys.level("c1", "apron") == "lumpwatch/v1/north-pit/c1/apron/level"
    assert keys.command("c1", "apron", "reset") == "lumpwatch/v1/north-pit/c1/apron/reset"
    assert keys.command("c1", "apron", "shelve") == "lumpwatch/v1/north-pit/c1/apron/shelve"
    assert keys.command("c1", "apron", "unshelve") == "lumpwatch/v1/north-pit/c1/apron/unshelve"
    assert keys.command("c1", "apron", "service") == "lumpwatch/v1/north-pit/c1/apron/service"
    assert keys.command("c1", "apron", "suppress") == "lumpwatch/v1/north-pit/c1/apron/suppress"
    assert keys.command("c1", "apron", "prior") == "lumpwatch/v1/north-pit/c1/apron/prior"
    assert keys.shadow("c1", "apron") == "lumpwatch/v1/north-pit/c1/apron/shadow"
    assert keys.alive("camera", "c1") == "lumpwatch/v1/north-pit/@alive/camera/c1"


def test_selectors_are_those_of_the_contract() -> None:
    keys = Keys("s")
    assert keys.frames() == "lumpwatch/v1/s/*/frame"
    assert keys.heartbeats() == "lumpwatch/v1/s/*/heartbeat"
    assert keys.states() == "lumpwatch/v1/s/*/*/state"
    assert keys.alarms() == "lumpwatch/v1/s/*/*/alarm"
    assert keys.levels() == "lumpwatch/v1/s/*/*/level"


def test_a_selector_matches_keys_of_its_own_kind_only() -> None:
    """A subscriber of one kind must never be handed the bytes of another."""
    keys = Keys("s")
    selectors = {
        Kind.FRAME: keys.frames(),
        Kind.HEARTBEAT: keys.heartbeats(),
        Kind.STATE: keys.states(),
        Kind.ALARM: keys.alarms(),
        Kind.LEVEL: keys.levels(),
        Kind.TEST: keys.tests(),
    }
    of = {kind: KEY_OF[kind].format(site="s", camera="c", roi="r", role="camera", name="c") for kind in Kind}
    for kind, selector in (*selectors.items(), *((one, on_every_site(one)) for one in Kind)):
        matched = {one for one in Kind if KeyExpr(selector).intersects(KeyExpr(of[one]))}
        assert matched == {kind}, selector


@given(names, names, names)
def test_parse_is_the_reverse(site: str, one: str, two: str) -> None:
    keys = Keys(site)
    assert parse(keys.frame(one)) == Address(site, Kind.FRAME, camera=one)
    assert parse(keys.jpeg(one)) == Address(site, Kind.JPEG, camera=one)
    assert parse(keys.heartbeat(one)) == Address(site, Kind.HEARTBEAT, camera=one)
    assert parse(keys.state(one, two)) == Address(site, Kind.STATE, camera=one, roi=two)
    assert parse(keys.alarm(one, two)) == Address(site, Kind.ALARM, camera=one, roi=two)
    assert parse(keys.level(one, two)) == Address(site, Kind.LEVEL, camera=one, roi=two)
    assert parse(keys.shadow(one, two)) == Address(site, Kind.SHADOW, camera=one, roi=two)
    assert parse(keys.alive(one, two)) == Address(site, Kind.ALIVE, role=one, name=two)


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_cannot_be_part_of_a_key(name: str) -> None:
    keys = Keys("s")
    calls: list[Callable[[], object]] = [
        lambda: Keys(name),
        lambda: keys.frame(name),
        lambda: keys.state("c", name),
        lambda: keys.alarm(name, "r"),
        lambda: keys.alive(name, "n"),
        lambda: keys.alive("r", name),
    ]
    for call in calls:
        with pytest.raises(ValueError, match="cannot be part of a bus key"):
            call()


@pytest.mark.parametrize(
    "key",
    [
        "",
        "lumpwatch",
        "lumpwatch/v1/s",
        "lumpwatch/v1/s/c",
        "lumpwatch/v2/s/c/frame",
        "other/lumpwatch/v1/s/c/frame",
        "lumpwatch/v1/s/c/picture",
        "lumpwatch/v1/s/c/frame/png",
        "lumpwatch/v1/s/c/r/state/more",
        "lumpwatch/v1/s/*/frame",
        "lumpwatch/v1/s/c//state",
        "lumpwatch/v1/s/@alive/camera",
    ],
)
def test_keys_of_something_else(key: str) -> None:
    with pytest.raises(ValueError, match=r"bus key|is not a key"):
        parse(key)


@given(st.text("ab1/@*é\n", max_size=60) | st.lists(st.sampled_from(PARTS)).map("/".join))
def test_parse_of_any_text_gives_parts_or_value_error(text: str) -> None:
    for key in (text, f"lumpwatch/v1/{text}"):
        try:
            address = parse(key)
        except ValueError:
            continue
        assert address.kind in Kind
