"""The dead man's switch: what a heartbeat may claim."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.core.clock import Clocks, utc
from lumpwatch.service.core.decision import Decision
from lumpwatch.service.monitor.heartbeat import LastDecision, heartbeat
from lumpwatch.service.protocol.silence import VALID_S

NOW = Clocks(1_000.0, 1.7e9)
ages = st.none() | st.floats(0.0, 100.0)
rois = st.dictionaries(
    st.sampled_from(["apron", "chute", "lip"]), st.tuples(st.sampled_from(Decision), ages), max_size=3
)


@given(rois, st.floats(0.1, 50.0))
def test_no_heartbeat_vouches_for_a_judgement_that_is_too_old(
    known: dict[str, tuple[Decision, float | None]], blind_after_s: float
) -> None:
    last = {
        roi: LastDecision(state, None if ago is None else NOW.monotonic_s - ago)
        for roi, (state, ago) in known.items()
    }
    beat = heartbeat("pit", "cam", 7, last, blind_after_s, NOW)
    for roi, (state, ago) in known.items():
        fresh = ago is not None and NOW.monotonic_s - (NOW.monotonic_s - ago) <= blind_after_s
        assert beat.rois[roi].state is state
        assert beat.rois[roi].valid == (state is Decision.BLIND or fresh)
    assert beat.valid == (bool(known) and all(one.valid for one in beat.rois.values()))


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_without_decisions_it_turns_invalid_and_stays_so(decided_s: float, later_s: float) -> None:
    """Valid once invalid again only after another decision."""
    first, second = sorted((decided_s, decided_s + later_s))
    last = {"apron": LastDecision(Decision.CLEAR, 0.0)}
    before, after = (heartbeat("p", "c", 1, last, 3.0, Clocks(now, 1.7e9)) for now in (first, second))
    assert before.valid or not after.valid


def test_what_it_says_of_a_roi() -> None:
    beat = heartbeat("pit", "cam", 7, {"apron": LastDecision(Decision.LUMP, 999.5)}, 3.0, NOW)
    one = beat.rois["apron"]
    assert (beat.seq, beat.valid_s, beat.time) == (7, VALID_S, utc(1.7e9))
    assert (one.decided_ago_s, one.decided, one.valid) == (0.5, utc(1.7e9 - 0.5), True)
