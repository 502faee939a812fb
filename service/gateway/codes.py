"""Words as numbers, for registers. A number is for ever: new words get new numbers, at the end."""

from __future__ import annotations

from lumpwatch.service.core import AlarmState, BlindReason, Decision, FeedState

DECISIONS: dict[str, int] = {Decision.CLEAR: 1, Decision.LUMP: 2, Decision.BLIND: 3, Decision.BLOCKED: 4}
"""What a region decides."""

ALARM_STATES: dict[str, int] = {
    AlarmState.NORMAL: 1,
    AlarmState.UNACKNOWLEDGED: 2,
    AlarmState.ACKNOWLEDGED: 3,
    AlarmState.RETURNED: 4,
    AlarmState.LATCHED: 5,
    AlarmState.SHELVED: 6,
    AlarmState.SUPPRESSED: 7,
    AlarmState.OUT_OF_SERVICE: 8,
}
"""Where an alarm stands."""

SEES = 1
"""In the place of a BLIND reason: the region sees."""
BLIND_REASONS: dict[str, int] = {
    BlindReason.STARTING: 2,
    BlindReason.UNFIT: 3,
    BlindReason.NO_STREAM: 4,
    BlindReason.STALE: 5,
    BlindReason.FILTER: 6,
    BlindReason.OVERLOAD: 7,
    BlindReason.FROZEN: 8,
    BlindReason.DARK: 9,
    BlindReason.GLARE: 10,
    BlindReason.MOVED: 11,
    BlindReason.DUSTY: 12,
    BlindReason.HIDDEN: 13,
    BlindReason.BLURRED: 14,
    BlindReason.EXPOSURE: 15,
    BlindReason.FEW_FRAMES: 16,
}
"""Why a region cannot see."""

FEED_STATES: dict[str, int] = {
    FeedState.UNKNOWN: 1,
    FeedState.RUNNING: 2,
    FeedState.STOPPED: 3,
    FeedState.EMPTY: 4,
}
"""What the feed does."""

OTHER = 65534
"""A word that has no number yet."""


def listed(codes: dict[str, int]) -> str:
    """The table in one line, for people."""
    return ", ".join(f"{number} {word}" for word, number in codes.items())
