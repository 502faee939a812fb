"""When certificates end, as Prometheus sees it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from prometheus_client import CollectorRegistry

from lumpwatch.service.telemetry.certificates import CertificateMetrics

METRIC = "lumpwatch_certificate_expiry_timestamp_seconds"
NOW = datetime(2026, 1, 1, tzinfo=UTC)


def certificate(days: float) -> bytes:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "lumpwatch")])
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(NOW - timedelta(days=1))
        .not_valid_after(NOW + timedelta(days=days))
        .sign(key, hashes.SHA256())
    )
    return made.public_bytes(serialization.Encoding.PEM)


def test_the_end_is_told_and_follows_the_file(tmp_path: Path) -> None:
    registry = CollectorRegistry()
    ca, own = tmp_path / "ca.pem", tmp_path / "own.pem"
    own.write_bytes(certificate(20) + certificate(10))
    CertificateMetrics(registry, {"ca": ca, "certificate": own})

    def told(which: str) -> float | None:
        return registry.get_sample_value(METRIC, {"certificate": which})

    assert told("ca") == 0.0  # there is no such file yet
    assert told("certificate") == (NOW + timedelta(days=10)).timestamp()  # the first that ends
    own.write_bytes(certificate(400))
    assert told("certificate") == (NOW + timedelta(days=400)).timestamp()
    own.write_bytes(b"no certificate")
    assert told("certificate") == 0.0
