"""Liveliness tokens as another program sees them: by zenoh alone, for the service itself watches none."""

from __future__ import annotations

import json
from types import TracebackType
from typing import Self

import zenoh

from lumpwatch.service.config import TlsConfig


class Tokens:
    """The tokens that a client sees, and what became of them since it joined; a context manager."""

    def __init__(self, endpoint: str, selector: str, tls: TlsConfig | None = None) -> None:
        self.events: list[tuple[str, bool]] = []
        """Key of a token, and whether it is there now and was not before or the reverse; those that were there already
        come first. What zenoh says again, as it may in answer to a query of the same session, is no change."""
        self._there: dict[str, bool] = {}
        self._selector = selector
        self._session = zenoh.open(_settings(endpoint, tls))
        self._session.liveliness().declare_subscriber(selector, self._changed, history=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def present(self) -> list[str]:
        """The keys of those that are there now, sorted. Raises TimeoutError where the hub has not answered in time."""
        replies = list(self._session.liveliness().get(self._selector, timeout=10.0))
        for reply in replies:
            if reply.err is not None:
                raise TimeoutError(f"{self._selector}: {reply.err.payload.to_string()}")
        return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    def _changed(self, sample: zenoh.Sample) -> None:
        key, there = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        if self._there.get(key, False) != there:
            self._there[key] = there
            self.events.append((key, there))


def _settings(endpoint: str, tls: TlsConfig | None) -> zenoh.Config:
    values: dict[str, object] = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [endpoint],
    }
    if tls is not None:
        values |= {
            "transport/link/tls/root_ca_certificate": str(tls.ca),
            "transport/link/tls/connect_certificate": str(tls.certificate),
            "transport/link/tls/connect_private_key": str(tls.key),
            "transport/link/tls/enable_mtls": True,
        }
    settings = zenoh.Config()
    for name, value in values.items():
        settings.insert_json5(name, json.dumps(value))
    return settings
