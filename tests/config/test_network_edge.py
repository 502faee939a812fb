"""Addresses as people write them: raw characters in passwords, passwords in odd places, an open bus."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lumpwatch.service.config import BusConfig, TlsConfig
from lumpwatch.service.config.source import encoded, redact


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("rtsp://u:p@h/s", "rtsp://u:p@h/s"),
        ("rtsp://u:a/b@10.0.0.5/s", "rtsp://u:a%2Fb@10.0.0.5/s"),
        ("rtsp://u:a?b@10.0.0.5:554/s?c=1", "rtsp://u:a%3Fb@10.0.0.5:554/s?c=1"),
        ("rtsp://u:a#b@10.0.0.5/s", "rtsp://u:a%23b@10.0.0.5/s"),
        ("rtsp://u:a@b@10.0.0.5/s", "rtsp://u:a%40b@10.0.0.5/s"),
        ("rtsp://u:100%@10.0.0.5/s", "rtsp://u:100%25@10.0.0.5/s"),
        ("rtsp://u:a%40b@10.0.0.5/s", "rtsp://u:a%40b@10.0.0.5/s"),
        ("rtsp://10.0.0.5:554/mail@x/s", "rtsp://10.0.0.5:554/mail@x/s"),
        ("rtsp://[fe80::1]:554/a@b", "rtsp://[fe80::1]:554/a@b"),
        ("clips/a@b.mp4", "clips/a@b.mp4"),
    ],
)
def test_user_and_password_are_taken_as_they_are_written(given: str, meant: str) -> None:
    assert encoded(given) == meant
    assert encoded(meant) == meant


@pytest.mark.parametrize(
    "url",
    [
        "rtsp://10.0.0.5/s?user=admin&password=hunter2",
        "rtsp://10.0.0.5/user=admin&password=hunter2&channel=1/s",
        "rtsp://10.0.0.5/a/user=admin_password=hunter2_channel=1",
        "rtsp://10.0.0.5/s#password=hunter2",
        "rtsp://10.0.0.5/s;password=hunter2",
        "rtsp://10.0.0.5?hunter2",
        "rtsp://u:x/hunter2@10.0.0.5/s",
    ],
)
def test_a_password_anywhere_is_hidden(url: str) -> None:
    assert "hunter2" not in redact(url)
    assert "10.0.0.5" in redact(url)


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.5:7447", "udp/0.0.0.0:1", "ws/hub:80", "tcp/*:1"],
)
def test_a_bus_beyond_loopback_without_certificates_must_be_asked_for(endpoint: str) -> None:
    with pytest.raises(ValidationError, match="insecure"):
        BusConfig(listen=(endpoint,))
    assert BusConfig(listen=(endpoint,), insecure=True).listen == (endpoint,)
    assert BusConfig(mode="client", connect=(endpoint,), listen=()).connect == (endpoint,)


def test_loopback_and_tls_need_no_word() -> None:
    BusConfig(listen=("tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:1", "unixsock-stream/run"))
    tls = TlsConfig.model_validate({"ca": "ca", "certificate": "c", "key": "k"})
    BusConfig(listen=("tls/0.0.0.0:7447",), tls=tls)
