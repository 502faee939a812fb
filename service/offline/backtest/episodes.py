"""The alarms that a threshold gives on a recording, and what they were worth.

The alarm's own state machine runs over the recorded probability. It is

    false      where no labelled lump was there at the raise, nor came or went within the tolerance,
    true       where one was, and until the clear an estimate lies on a labelled lump at some frame,
    misplaced  where one was, but no estimate ever lay on a lump.

A lump counts as warned of from the first frame before its lip at which the alarm stands with an
estimate on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.core import Alarm, Change, step_alarm
from lumpwatch.service.offline.backtest.record import Array, Recording
from lumpwatch.service.offline.backtest.truth import Truth, near

Verdict = Literal["true", "false", "misplaced"]


@dataclass(frozen=True, slots=True)
class Episode:
    """One alarm."""

    raised: int
    """Index of the recorded frame at which it was raised."""
    cleared: int
    """Index of the one at which it was cleared; the number of frames where it stood to the end."""
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Score:
    """What one threshold does on one recording."""

    episodes: tuple[Episode, ...]
    warned_s: tuple[float | None, ...]
    """For each lump: seconds before its lip, None without a warning."""
    standing_s: float
    """For how long the alarm stood without a lump: none coming, and the last one gone for longer than
    the alarm needs to clear."""

    def count(self, verdict: Verdict) -> int:
        """Number of episodes with that verdict."""
        return sum(episode.verdict == verdict for episode in self.episodes)


def alarm_at(config: AlarmConfig, raise_above: float) -> AlarmConfig:
    """The alarm with another threshold and without latch.

    Up from the configured threshold `clear_below` stays, below it it shrinks in proportion.
    """
    clear_below = config.clear_below * min(1.0, raise_above / config.raise_above)
    return config.model_copy(update={"raise_above": raise_above, "clear_below": clear_below, "latch": False})


def spans(times: Array, alarming: Array, config: AlarmConfig) -> list[tuple[int, int]]:
    """Indices of raise and clear of every alarm; the number of frames for one that stands to the end."""
    alarm, raised, found = Alarm(), 0, []
    for k, (time_s, probability) in enumerate(zip(times.tolist(), alarming.tolist(), strict=True)):
        alarm, transition = step_alarm(alarm, config, probability, time_s)
        if transition is None:
            continue
        if transition.change is Change.RAISED:
            raised = k
        else:
            found.append((raised, k))
    if alarm.active:
        found.append((raised, len(times)))
    return found


def score(recording: Recording, truth: Truth, config: AlarmConfig, tolerance_s: float) -> Score:
    """Judge the alarms of one recording at the thresholds of `config`."""
    times = recording.times
    at_hand = near(times, truth.lumps, tolerance_s, tolerance_s)
    touched = np.zeros(len(times), dtype=np.bool_)
    for lump in truth.lumps:
        touched[lump.on] = True
    standing = np.zeros(len(times), dtype=np.bool_)
    episodes = []
    for raised, cleared in spans(times, recording.alarming, config):
        standing[raised:cleared] = True
        verdict: Verdict = "misplaced"
        if not at_hand[raised]:
            verdict = "false"
        elif touched[raised:cleared].any():
            verdict = "true"
        episodes.append(Episode(raised, cleared, verdict))
    warned = []
    for lump in truth.lumps:
        before = lump.on[standing[lump.on] & (times[lump.on] < lump.lip_s)]
        warned.append(lump.lip_s - float(times[before[0]]) if len(before) else None)
    idle = standing & ~near(times, truth.lumps, tolerance_s, tolerance_s + config.off_delay_s)
    return Score(tuple(episodes), tuple(warned), float(recording.intervals[idle].sum()))
