"""The line that `lumpwatch demo` prints of a region."""

from __future__ import annotations

from lumpwatch.service.cli.demo import _line
from lumpwatch.service.protocol import FeedRecord, StateMessage
from lumpwatch.service.protocol.examples import example


def test_it_says_what_the_feed_does_and_nothing_of_what_is_not_known() -> None:
    state = StateMessage.model_validate(example(StateMessage))
    assert "feed running 0.60 m/s load 93%" in _line(state, 15.0)
    unknown = state.model_copy(update={"feed": FeedRecord.model_validate({"state": "unknown"})})
    assert _line(unknown, 15.0).rstrip().endswith("belt")
    assert "feed unknown  " in _line(unknown, 15.0)
    assert "feed" not in _line(state.model_copy(update={"feed": None}), 15.0)
