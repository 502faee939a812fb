"""Counting how a shadow differs: timelines worked by hand, and pairs against brute force."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from lumpwatch.service.detection.shadow.budget import Budget
from lumpwatch.service.detection.shadow.differences import Difference, Differences
from lumpwatch.service.protocol.shadow import Counts


def run(current: str, shadow: str, match_s: float = 3.0, longest_s: float = 10.0) -> Differences:
    """One character a second: `#` is an alarm; a blank of both is a second without a decision."""
    target = Differences(match_s, longest_s)
    for second, (ours, theirs) in enumerate(zip(current, shadow, strict=True)):
        if ours != " ":
            target.step(float(second), ours == "#", theirs == "#")
    return target


def alarms(counts: Counts) -> tuple[int, int, int]:
    return counts.both, counts.only_current, counts.only_shadow


def seconds(counts: Counts) -> tuple[float, float, float]:
    return counts.agree_s, counts.only_current_s, counts.only_shadow_s


@pytest.mark.parametrize(
    ("current", "shadow", "expected", "spent", "lead"),
    [
        # The state of a second holds until the next one: eleven frames are ten seconds.
        ("...........", "...........", (0, 0, 0), (10, 0, 0), 0.0),
        ("..###......", "..###......", (1, 0, 0), (10, 0, 0), 0.0),
        # The shadow is two seconds earlier and one later at the end.
        ("....###....", "..######...", (1, 0, 0), (7, 0, 3), 2.0),
        # Three seconds later is still the same alarm, four are not.
        ("..#........", ".....#.....", (1, 0, 0), (8, 1, 1), -3.0),
        ("..#........", "......#....", (0, 1, 1), (8, 1, 1), 0.0),
        ("..###......", "...........", (0, 1, 0), (7, 3, 0), 0.0),
        ("...........", "..##..##...", (0, 0, 2), (6, 0, 4), 0.0),
        # An alarm is part of one pair only.
        (".#.#.......", "..#........", (1, 1, 0), (7, 2, 1), -1.0),
        # One that is too young to be judged is not counted yet.
        (".........#.", "...........", (0, 0, 0), (9, 1, 0), 0.0),
        # What stood at the start is held against nobody: counting begins at second 3.
        ("###........", ".#.........", (0, 0, 0), (7, 0, 0), 0.0),
        ("###........", "..####.....", (0, 0, 0), (4, 0, 3), 0.0),
    ],
)
def test_timelines(
    current: str, shadow: str, expected: tuple[int, ...], spent: tuple[float, ...], lead: float
) -> None:
    counts = run(current, shadow).counts
    assert alarms(counts) == expected
    assert seconds(counts) == spent
    assert counts.lead_s == lead
    assert counts.judged_s == sum(spent)


def test_a_gap_counts_for_nobody() -> None:
    """Twelve blind seconds: neither they nor the alarm before them are counted."""
    counts = run(
        "...#" + " " * 12 + "....",
        "...." + " " * 12 + "....",
    ).counts
    assert seconds(counts) == (6.0, 0.0, 0.0)
    assert alarms(counts) == (0, 0, 0)


def test_a_short_gap_is_as_decided_before_it() -> None:
    assert seconds(run("..##    ..", "......    "[:2] + "..    ..").counts) == (3.0, 6.0, 0.0)


def test_each_alarm_is_told_once() -> None:
    target = Differences(3.0, 10.0)
    steps = [(0, 0, 0), (1, 0, 1), (2, 1, 1), (3, 0, 0), (4, 0, 1), (7, 0, 0), (8, 0, 0)]
    told = [one for time_s, ours, theirs in steps for one in target.step(time_s, bool(ours), bool(theirs))]
    assert told == [Difference("both", 1, 1.0), Difference("only_shadow", 4)]


def test_counting_goes_on_from_what_was_kept() -> None:
    kept = Counts(agree_s=100.0, both=4, lead_s=2.5)
    target = Differences(3.0, 10.0, kept)
    target.step(0.0, False, False)
    target.step(1.0, True, True)
    assert target.counts == Counts(agree_s=101.0, both=5, lead_s=2.5)


def test_an_interruption_forgets_what_waits() -> None:
    target = Differences(3.0, 10.0)
    target.step(0.0, False, False)
    target.step(1.0, True, False)
    target.interrupt()
    target.step(9.0, False, True)
    assert target.step(10.0, False, True) == ()
    assert target.counts == Counts(agree_s=1.0, only_shadow_s=1.0)


lines = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60)


@given(lines, st.integers(1, 8))
@settings(max_examples=200, deadline=None)
def test_pairs_are_as_many_as_can_be_made(line: list[tuple[bool, bool]], match_s: int) -> None:
    """Against a maximum matching of the alarms within the tolerance, and a sum over the seconds."""
    line = [(False, False), *line, *[(False, False)] * (match_s + 2)]
    target = Differences(match_s, 1000.0)
    for second, (ours, theirs) in enumerate(line):
        target.step(float(second), ours, theirs)
    raised = [
        [t for t, (a, b) in enumerate(pairwise(line), start=1) if b[side] and not a[side]] for side in (0, 1)
    ]
    near = np.abs(np.subtract.outer(raised[0], raised[1])) <= match_s
    pairs = 0
    if near.size:
        pairs = int((maximum_bipartite_matching(csr_array(near.astype(np.int8)), "column") >= 0).sum())
    assert alarms(target.counts) == (pairs, len(raised[0]) - pairs, len(raised[1]) - pairs)
    held = line[:-1]
    assert seconds(target.counts) == (
        sum(a == b for a, b in held),
        sum(a and not b for a, b in held),
        sum(b and not a for a, b in held),
    )


# The time that shadows may take


def looks(cost_s: float, spent_s: float, frames: int, interval_s: float = 1.25) -> list[bool]:
    """On which frames a shadow that costs so much runs; one second of each interval may be used."""
    budget, ran = Budget(), []
    for _ in range(frames):
        budget.earn(interval_s, spent_s)
        ran.append(budget.allows("apron"))
        if ran[-1]:
            budget.spend("apron", cost_s)
    return ran


def test_what_fits_runs_on_every_frame() -> None:
    assert all(looks(cost_s=0.5, spent_s=0.5, frames=50))


def test_what_costs_twice_what_is_left_runs_on_every_second_frame() -> None:
    ran = looks(cost_s=1.0, spent_s=0.5, frames=43)
    assert ran[:3] == [True, False, False]  # what it costs is not known before the first look
    assert ran[3:] == [True, False] * 20


@pytest.mark.parametrize("spent_s", [1.0, 1.25, 5.0])
def test_a_machine_that_is_busy_anyway_runs_no_shadow(spent_s: float) -> None:
    assert not any(looks(cost_s=0.001, spent_s=spent_s, frames=200))


def test_a_hiccup_does_not_keep_the_shadow_away_for_long() -> None:
    budget = Budget()
    budget.earn(0.1, 0.0)
    budget.spend("apron", 3600.0)
    budget.forget("apron")  # its cost: only the debt is looked at here
    waited = 0
    while not budget.allows("apron"):
        budget.earn(0.1, 0.0)
        waited += 1
    assert waited == 13  # a debt of 1 s at 80 ms a frame


@given(
    st.lists(st.floats(0.0, 0.5), min_size=1, max_size=60),
    st.floats(0.001, 0.5),
    st.floats(0.0, 0.2),
)
def test_the_share_is_never_exceeded_by_more_than_one_look(
    intervals: list[float], cost_s: float, spent_s: float
) -> None:
    budget, used, earned = Budget(), 0.0, 0.0
    for interval_s in intervals:
        budget.earn(interval_s, spent_s)
        earned += max(0.0, 0.8 * interval_s - spent_s)
        if budget.allows("apron"):
            budget.spend("apron", cost_s)
            used += cost_s
        assert used <= earned + cost_s + 1e-9
