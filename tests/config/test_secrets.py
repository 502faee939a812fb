"""No password ever appears in an error, a representation or a redacted URL."""

from __future__ import annotations

import json
from typing import Any
from urllib.parse import quote

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lumpwatch.service.config import parse_config
from lumpwatch.service.config.source import redact
from lumpwatch.service.errors import ConfigError
from tests.service_helpers import site_tree

PASSWORD = "hunter2-s3cret"
URL = f"rtsp://operator:{PASSWORD}@10.0.0.5/stream"
PLACE = "rtsp://***@10.0.0.5:554/stream?***"
PASSWORDS = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"]), min_size=4, max_size=20),
    st.text("ab/?@:#%[]&=; ", min_size=4, max_size=20),
)


def with_url(url: str) -> dict[str, Any]:
    tree = site_tree()
    tree["cameras"][0]["source"] = {"url": url}
    return tree


def spoken(text: str, environ: dict[str, str] | None = None) -> str:
    """All that the configuration says of itself: its representation, or the error."""
    try:
        config = parse_config(text, "site.yaml", environ or {})
    except ConfigError as error:
        return str(error)
    return f"{config!r} {config} {config.model_dump()} {config.model_dump_json()} {config.cameras[0].source.redacted}"


@settings(deadline=None)
@given(PASSWORDS, st.booleans(), st.sampled_from(["", "?channel=1", "?token=abcd"]))
def test_redact_hides_any_password(password: str, encoded: bool, query: str) -> None:
    assume(password not in PLACE)
    written = quote(password, safe="") if encoded else password
    hidden = redact(f"rtsp://operator:{written}@10.0.0.5:554/stream{query}")
    assert password not in hidden
    assert written not in hidden or written in PLACE
    assert "operator" not in hidden
    assert "abcd" not in hidden
    assert hidden.startswith("rtsp://***@10.0.0.5:554/stream")


@pytest.mark.parametrize(
    ("url", "hidden"),
    [
        ("rtsp://10.0.0.5/stream", "rtsp://10.0.0.5/stream"),
        ("rtsp://u:p@10.0.0.5/stream", "rtsp://***@10.0.0.5/stream"),
        ("rtsp://u@10.0.0.5/stream", "rtsp://***@10.0.0.5/stream"),
        ("rtsp://u:a/b?c@d#e@10.0.0.5/s", "rtsp://***@10.0.0.5/s"),
        ("rtsp://10.0.0.5/s?user=u&password=p", "rtsp://10.0.0.5/s?***"),
        ("clips/a.mp4", "clips/a.mp4"),
        ("sim:feed?dust=0.5", "sim:feed?dust=0.5"),
    ],
)
def test_redact(url: str, hidden: str) -> None:
    assert redact(url) == hidden


@settings(deadline=None)
@given(PASSWORDS)
def test_a_url_with_any_password_is_taken_or_refused_without_telling_it(password: str) -> None:
    assume("${" not in password)
    benign = (
        spoken(json.dumps(with_url("rtsp://u:0@10.0.0.5/x")))
        + " url is not a valid RTSP address names no host"
    )
    assume(password not in benign)
    assert password not in spoken(json.dumps(with_url(f"rtsp://u:{password}@10.0.0.5/x")))


@pytest.mark.parametrize(
    "url",
    [
        URL,
        URL.replace("@10.0.0.5", "@"),
        URL.replace("10.0.0.5", "[::1"),
        URL.replace("rtsp:", "http:"),
        pytest.param(URL.replace("rtsp://", "")),
        URL.replace("rtsp://", "rtsp:"),
    ],
)
def test_a_wrong_url_is_refused_without_telling_it(url: str) -> None:
    assert PASSWORD not in spoken(json.dumps(with_url(url)))


def test_a_password_from_the_environment_is_not_told() -> None:
    text = json.dumps(with_url(URL.replace(PASSWORD, "${CAM_PASSWORD}"))).replace(
        '"url"', '"nonsense": 1, "url"'
    )
    assert PASSWORD not in spoken(text, {"CAM_PASSWORD": PASSWORD})


def _source_without_url_key() -> str:
    tree = site_tree()
    tree["cameras"][0]["source"] = URL
    return json.dumps(tree)


def _in_the_wrong_place() -> str:
    tree = site_tree()
    tree["cameras"][0]["rois"][0]["id"] = "${CAM_PASSWORD}!"
    return json.dumps(tree)


@pytest.mark.parametrize(
    "text",
    [
        _source_without_url_key(),
        json.dumps({"site": "s", "cameras": URL}),
        json.dumps(with_url(URL)).replace('"url":', f'"url": "{URL}", "url":'),
        _in_the_wrong_place(),
        json.dumps({**site_tree(), "telemetry": {"listen": "${CAM_PASSWORD}"}}),
        json.dumps({**site_tree(), "bus": {"listen": [f"tls/operator:{PASSWORD}@host 1"]}}),
    ],
)
def test_a_secret_in_the_wrong_place_is_not_told(text: str) -> None:
    assert PASSWORD not in spoken(text, {"CAM_PASSWORD": PASSWORD})
