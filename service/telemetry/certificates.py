"""When the certificates of this process end. A link of the bus ends with them, and nobody connects any more."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from cryptography import x509
from prometheus_client import CollectorRegistry, Gauge


class CertificateMetrics:
    """The end of each certificate file, read anew whenever it is asked for: a renewed file shows at once."""

    def __init__(self, registry: CollectorRegistry, files: Mapping[str, Path]) -> None:
        """`files` by what they are, such as `ca` and `certificate`."""
        gauge = Gauge(
            "lumpwatch_certificate_expiry_timestamp_seconds",
            "When a certificate of the bus ends, seconds since the epoch; 0: its file cannot be read.",
            ("certificate",),
            registry=registry,
        )
        for name, path in files.items():
            gauge.labels(name).set_function(partial(ends_at, path))


def ends_at(path: Path) -> float:
    """When the first of the certificates in a PEM file ends, seconds since the epoch; 0 where it cannot be read."""
    try:
        found = x509.load_pem_x509_certificates(path.read_bytes())
    except (OSError, ValueError):
        return 0.0
    return min(one.not_valid_after_utc.timestamp() for one in found)
