"""When findings make a ROI BLIND, and when they stop to."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.core.debounce import DebounceTimes, ReasonDebouncer
from lumpwatch.service.core.decision import BlindReason

R = BlindReason
TIMES = {
    R.DARK: DebounceTimes(1.0, 2.0),
    R.GLARE: DebounceTimes(2.0, 1.0),
    R.BLURRED: DebounceTimes(3.0, 2.0),
}


def said(findings: list[tuple[float, set[BlindReason]]]) -> list[BlindReason | None]:
    debouncer = ReasonDebouncer(TIMES)
    return [debouncer.step(time_s, found) for time_s, found in findings]


def test_a_finding_must_last_and_so_must_its_end() -> None:
    findings = [(k / 2, {R.DARK} if 2 <= k < 6 else set()) for k in range(14)]
    # Found from 1.0 to 2.5 s: BLIND from 2.0 s, and from 3.0 s on two seconds more.
    assert [k for k, one in enumerate(said(findings)) if one is R.DARK] == list(range(4, 10))


def test_a_short_break_starts_the_time_again() -> None:
    findings = [(k / 2, set() if k == 3 else {R.GLARE}) for k in range(8)]
    assert said(findings) == [None] * 8
    assert said([*findings, (4.0, {R.GLARE})])[-1] is R.GLARE


def test_the_first_reason_of_the_list_is_told() -> None:
    assert said([(0.0, {R.DARK, R.BLURRED}), (5.0, {R.DARK, R.BLURRED}), (5.1, {R.BLURRED})])[-1] is R.DARK


def test_reasons_that_take_turns_are_blind_after_the_longest_time() -> None:
    turns = [R.DARK, R.GLARE, R.BLURRED]
    findings = [(0.5 * k, {turns[k % 3]}) for k in range(8)]
    assert said(findings)[:6] == [None] * 6
    assert said(findings)[6] is R.DARK


def test_what_is_switched_off_is_not_found() -> None:
    assert said([(0.0, {R.FROZEN}), (100.0, {R.FROZEN})]) == [None, None]


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 1.5),
            st.sets(st.sampled_from([R.DARK, R.GLARE, R.BLURRED, R.FROZEN])),
        ),
        min_size=1,
        max_size=30,
    )
)
def test_nothing_unfit_is_clear_for_longer_than_the_limit(
    steps: list[tuple[float, set[BlindReason]]],
) -> None:
    debouncer, time_s = ReasonDebouncer(TIMES), 0.0
    since: float | None = None
    quiet: float | None = None
    for wait_s, found in steps:
        time_s += wait_s
        reason = debouncer.step(time_s, found)
        unfit = bool(found & set(TIMES))
        since = (time_s if since is None else since) if unfit else None
        quiet = None if unfit else (time_s if quiet is None else quiet)
        if since is not None and time_s - since >= debouncer.limit_s:
            assert reason is not None
        if quiet is not None and time_s - quiet >= max(one.exit_s for one in TIMES.values()):
            assert reason is None
        assert reason is None or reason in TIMES
