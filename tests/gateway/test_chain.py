"""Whether a region may be believed, judged with a clock of the test's own."""

from __future__ import annotations

import pytest

from lumpwatch.service.core import AlarmClass, AlarmState, BlindReason, Decision, FeedState
from lumpwatch.service.gateway.chain import BEAT_EVERY_S, Chain
from lumpwatch.service.gateway.values import FeedValues, Quality, RegionValues, Why, following
from lumpwatch.service.protocol import FeedRecord
from tests.gateway.site import REGION, alarm, beat, config, level, lump, state

MONITOR, DAEMON = "lumpwatch/v1/pit/@alive/monitor/cam", "lumpwatch/v1/pit/@alive/daemon/pit"
STATE = "lumpwatch/v1/pit/cam/apron/state"


class Told:
    """A chain that has heard everything that it needs."""

    def __init__(self) -> None:
        self.now = 100.0
        self.connected = True
        self.chain = Chain(config(), (REGION,), lambda: self.now)
        self.chain.connected = lambda: self.connected
        self.seq = 0

    def all(self, decision: Decision = Decision.CLEAR, reason: BlindReason | None = None) -> None:
        self.chain.on_token(DAEMON, True)
        self.chain.on_token(MONITOR, True)
        self.seq += 1
        self.chain.on_heartbeat("", beat(self.seq).line())
        blind = decision is Decision.BLIND
        self.chain.on_state(STATE, state(decision, frame=self.seq, reason=reason).line())
        self.chain.on_level(STATE, level(lump=decision is Decision.LUMP, blind=blind).line())

    @property
    def region(self) -> RegionValues:
        (region,) = self.chain.values().regions
        return region

    def beats(self, seconds: float, *, telling: bool) -> int:
        """How far the counter rises in so long."""
        before = self.region.heartbeat
        for _ in range(round(seconds / BEAT_EVERY_S)):
            self.now += BEAT_EVERY_S
            if telling:
                self.all()
            values = self.chain.values()
        return values.regions[0].heartbeat - before


@pytest.fixture
def told() -> Told:
    return Told()


def test_nothing_is_available_before_everything_was_heard(told: Told) -> None:
    assert (told.region.quality, told.region.why) == (Quality.BAD, Why.STARTING)
    told.chain.on_token(DAEMON, True)
    told.chain.on_token(MONITOR, True)
    told.chain.on_heartbeat("", beat().line())
    told.chain.on_state(STATE, state().line())
    region = told.region  # no level yet
    assert (region.quality, region.why, region.lives) == (Quality.BAD, Why.STARTING, False)
    unknown = (region.decision, region.existence, region.count, region.prior, region.lump, region.blocked)
    assert set(unknown) == {None}
    assert not region.alarms
    assert region.heartbeat == 0
    told.all()
    assert (told.region.quality, told.region.why) == (Quality.GOOD, Why.GOOD)
    assert told.region.clear


def test_the_counter_rises_only_while_the_whole_chain_lives(told: Told) -> None:
    told.all()
    assert told.beats(5.0, telling=True) == 20
    assert told.beats(3.0, telling=False) in (11, 12)  # heartbeats are valid for 3 s
    assert told.beats(10.0, telling=False) == 0
    assert told.region.why is Why.HEARTBEAT_EXPIRED
    assert told.beats(1.0, telling=True) == 4


def test_values_that_are_asked_for_more_often_make_no_more_beats(told: Told) -> None:
    told.all()
    told.region  # noqa: B018
    before = told.region.heartbeat
    for _ in range(100):
        told.now += 0.001
        assert told.region.heartbeat == before


def test_a_process_that_is_gone_is_noticed_at_once(told: Told) -> None:
    for token in (MONITOR, DAEMON):
        told.all()
        told.chain.on_token(token, False)
        assert (told.region.quality, told.region.why) == (Quality.BAD, Why.PROCESS_GONE)
        assert not told.region.lives


def test_a_bus_that_is_not_reached_is_bad_whatever_was_heard(told: Told) -> None:
    told.all(Decision.LUMP)
    told.connected = False
    assert (told.region.quality, told.region.why, told.region.lump) == (Quality.BAD, Why.NO_BUS, None)


def test_a_heartbeat_that_says_invalid_counts_like_none(told: Told) -> None:
    told.all()
    told.chain.on_heartbeat("", beat(2, valid=False).line())
    assert told.region.why is Why.HEARTBEAT_INVALID
    assert told.region.decision is None


def test_decisions_that_have_stopped_are_noticed_though_the_monitor_lives(told: Told) -> None:
    told.all()
    told.chain.on_heartbeat("", beat(2, ago_s=5.0).line())  # blind_after_s 3, told once a second
    assert told.region.why is Why.NOT_DECIDING
    told.chain.on_heartbeat("", beat(3, ago_s=None).line())
    assert told.region.why is Why.NOT_DECIDING


def test_states_that_stop_while_heartbeats_come(told: Told) -> None:
    told.all()
    told.now += 3.1
    told.chain.on_heartbeat("", beat(2).line())
    assert told.region.why is Why.STATE_EXPIRED


@pytest.mark.parametrize("reason", list(BlindReason))
def test_blind_is_bad_and_tells_why_and_only_a_broken_chain_stops_the_counter(
    told: Told, reason: BlindReason
) -> None:
    told.all(Decision.BLIND, reason)
    region = told.region
    assert (region.quality, region.why, region.blind_reason) == (Quality.BAD, Why.BLIND, reason)
    assert region.existence is region.count is region.largest_mm is region.lip_s is None
    assert region.alarms[AlarmClass.LUMP] is AlarmState.NORMAL  # the monitor lives, so its alarms are known
    broken = {"starting", "unfit", "no_stream", "stale", "filter", "frozen"}
    assert region.lives is (reason.value not in broken)
    assert not region.clear


def test_a_degraded_region_is_uncertain(told: Told) -> None:
    told.all()
    told.chain.on_level(STATE, level(system=True).line())
    assert (told.region.quality, told.region.why) == (Quality.UNCERTAIN, Why.DEGRADED)
    assert told.region.lives
    assert not told.region.clear


def test_what_is_seen_of_lumps(told: Told) -> None:
    told.all()
    seen = state(
        Decision.LUMP, frame=9, age_s=0.5,
        objects=(lump(812.0, 3.1), lump(950.0, 4.0), lump(1500.0, 1.0, counts=False), lump(None, None)),
    )  # fmt: skip
    told.chain.on_state(STATE, seen.line())
    told.now += 0.6
    region = told.region
    assert (region.count, region.largest_mm, region.limit_mm, region.prior) == (3, 950.0, 700.0, 3)
    assert region.lip_s == pytest.approx(3.1 - 0.5 - 0.6)  # counted from the capture
    assert region.speed_mm_s == pytest.approx(400.0)
    assert region.existence == 0.97
    assert not region.clear


def test_an_alarm_record_counts_before_the_next_state_and_an_old_one_does_not(told: Told) -> None:
    told.all()
    told.chain.on_alarm(STATE, alarm("UNACKNOWLEDGED", 5).line())
    assert told.region.alarms[AlarmClass.LUMP] is AlarmState.UNACKNOWLEDGED
    assert told.region.sequence == 5
    stands = {AlarmClass.LUMP: AlarmState.ACKNOWLEDGED}
    told.chain.on_state(STATE, state(alarms=stands, sequence=6).line())
    assert told.region.alarms[AlarmClass.LUMP] is AlarmState.ACKNOWLEDGED


def test_a_lump_that_is_held_is_no_clear(told: Told) -> None:
    told.all()
    told.chain.on_level(STATE, level(lump=True).line())
    assert told.region.quality is Quality.GOOD
    assert not told.region.clear


def test_a_blockage_is_no_clear_and_the_feed_is_told(told: Told) -> None:
    told.all()
    feed = FeedRecord(state=FeedState.RUNNING, speed_mm_s=598.0, load=0.9, visible_p80_mm=340)
    told.chain.on_state(STATE, state(feed=feed).line())
    told.chain.on_level(STATE, level(blocked=True).line())
    assert told.region.blocked
    assert not told.region.clear
    assert told.region.feed == FeedValues("running", 598.0, 0.9, 340.0)


def test_rubbish_is_counted_and_changes_nothing(told: Told) -> None:
    told.all()
    for payload in (b"", b"{}", b"[" * 1000, b"\xff", b'{"state": "CLEAR"}'):
        told.chain.on_heartbeat("x", payload)
        told.chain.on_state(STATE, payload)
        told.chain.on_level(STATE, payload)
        told.chain.on_alarm(STATE, payload)
    told.chain.on_alarm(STATE, alarm("NONSENSE", 9).line())
    told.chain.on_state("lumpwatch/v1/pit/other/apron/state", state(Decision.LUMP).line())
    told.chain.on_state("short", state(Decision.LUMP).line())
    assert told.chain.malformed == 21
    assert told.region.clear


def test_the_counter_never_returns_to_zero() -> None:
    assert [following(n) for n in (0, 1, 65534, 65535)] == [1, 2, 65535, 1]


def test_the_site_lives_only_while_all_regions_do() -> None:
    two = config().model_copy(
        update={
            "cameras": tuple(config().cameras[0].model_copy(update={"id": name}) for name in ("cam", "b"))
        }
    )
    now = 100.0
    chain = Chain(two, (REGION, ("b", "apron")), lambda: now)
    chain.connected = lambda: True
    chain.on_token(DAEMON, True)
    chain.on_token(MONITOR, True)
    chain.on_heartbeat("", beat().line())
    chain.on_state(STATE, state().line())
    chain.on_level(STATE, level().line())
    values = chain.values()
    assert values.heartbeat == 0
    assert values.quality is Quality.BAD
    assert [region.heartbeat for region in values.regions] == [1, 0]
