"""Regions that watch a mouth: which keys fit, and what is said of those that do not."""

from __future__ import annotations

from typing import Any

import pytest

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.errors import ConfigError
from tests.service_helpers import site

POLYGON = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.5], [0.1, 0.5]]
APRON: dict[str, Any] = {"id": "apron", "polygon": POLYGON}
MOUTH: dict[str, Any] = {"id": "mouth", "watch": "mouth", "polygon": POLYGON}


def parse(*rois: dict[str, Any]) -> CameraConfig:
    camera = {"id": "cam", "source": {"url": "clip.mp4"}, "rois": list(rois)}
    return site({"site": "pit", "cameras": [camera]}).cameras[0]


def test_a_mouth_beside_its_belt() -> None:
    camera = parse(APRON, MOUTH | {"mouth": {"belt": "apron"}, "alarm": {"blocked": {"on_delay_s": 5.0}}})
    belt, mouth = camera.rois
    assert (belt.watches_mouth, mouth.watches_mouth) == (False, True)
    assert (mouth.mouth.belt, mouth.alarm.blocked.on_delay_s) == ("apron", 5.0)
    assert mouth.working_size_px == mouth.mouth.working_size_px
    # As evidence and proof tests write it down and read it again.
    assert parse(*(roi.model_dump(mode="json") for roi in camera.rois)) == camera


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"detector": {"particles": 100}}, "detector: does not fit `watch: mouth`"),
        ({"detector": {"kind": "jpda"}}, "detector: does not fit `watch: mouth`"),
        ({"learning": {"footage_mb": 10}}, "learning: does not fit"),
        ({"alarm": {"raise_above": 0.8}}, "alarm.raise_above: is of the lump alarm"),
        ({"alarm": {"on_delay_s": 3.0}}, "set under alarm.blocked"),
        ({"proof_test": {"least_warning_s": 1.0}}, "proof_test.least_warning_s: does not fit"),
        ({"feed": {"rate_hz": 2.0}}, "feed.rate_hz: does not fit"),
        ({"mouth": {"free_below": 0.4}}, "free_below (0.4) must be smaller than blocked_above (0.25)"),
        ({"mouth": {"belt": "other"}}, "mouth.belt: 'other' is no roi of this camera"),
        ({"mouth": {"belt": "mouth"}}, "'mouth' watches a mouth, expected a roi that watches a belt"),
        ({"mouth": {"level": 1}}, "level"),
        ({"watch": "chute"}, "watch"),
    ],
)
def test_what_does_not_fit_a_mouth_is_refused_by_name(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(APRON, MOUTH | changed)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"mouth": {"blocked_above": 0.5}}, "mouth: belongs to a roi with `watch: mouth`"),
        ({"alarm": {"blocked": {"on_delay_s": 3.0}}}, "alarm.blocked: belongs to a roi with `watch: mouth`"),
    ],
)
def test_what_does_not_fit_a_belt_is_refused_by_name(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(APRON | changed)
    assert message in str(caught.value)


def test_a_belt_whose_feed_is_not_looked_at_tells_nothing() -> None:
    with pytest.raises(ConfigError, match="feed of 'apron' is not looked at"):
        parse(APRON | {"feed": {"enabled": False}}, MOUTH | {"mouth": {"belt": "apron"}})
