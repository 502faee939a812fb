"""Whatever comes to the pipeline, in whatever order: it never says CLEAR of a picture that is too old."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.messages import Decision
from service.pipeline import CameraPipeline
from tests.service_helpers import camera, frame, prior

CONFIG = camera(particles=50)
KNOWN = {"apron": prior()}
EVENTS = st.lists(
    st.tuples(
        st.floats(0.0, 1.5),  # seconds until it happens
        st.sampled_from(("frame", "same again", "nothing")),
        st.floats(0.0, 2.0),  # age of the picture when it comes
        st.booleans(),  # whether the lump is in it
    ),
    max_size=12,
)


@pytest.mark.slow
@settings(max_examples=60)
@given(EVENTS)
def test_clear_needs_a_picture_that_is_young_enough(events: list[tuple[float, str, float, bool]]) -> None:
    target = CameraPipeline(CONFIG, KNOWN)
    now, last = 100.0, None
    newest: float | None = None
    received = 0.0
    for number, (wait_s, kind, age_s, bright) in enumerate(events):
        now += wait_s
        if kind == "frame":
            last = frame(number, time_s=now - age_s, received_s=now, bright=bright)
        results = target.process(last, now) if last is not None and kind != "nothing" else ()
        if last is not None and results:
            newest, received = last.capture_s, now
        for result in results or target.look(now):
            young = newest is not None and max(now - newest, now - received) <= CONFIG.blind_after_s
            assert (result.decision is not Decision.BLIND) == young
