"""Certificates of the bus that are renewed while the daemon runs: the hub is started anew, and everybody joins again.

A hub reads its files when it begins to listen, clients whenever they connect. So a new hub is all it takes, also where
authority and certificates change together. What is sent meanwhile waits for it, as in any outage.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

from lumpwatch.service.config import TlsConfig

log = logging.getLogger(__name__)

EVERY_S = 2.0
"""Files that are the same for so long are complete: they are copied one after the other."""


class CertificateWatch:
    """Looks at the files every two seconds; a pair that does not fit changes nothing, and that is logged once."""

    def __init__(self, tls: TlsConfig | None, clock: Callable[[], float] = time.monotonic) -> None:
        """None: a bus without certificates, of which nothing is ever renewed."""
        self._tls = tls
        self._clock = clock
        self._in_use = self._before = self._content()
        self._next_s = clock() + EVERY_S

    def renewed(self) -> bool:
        """Whether there are other files than those in use, complete and fit; true once for each of them."""
        now = self._clock()
        if self._tls is None or now < self._next_s:
            return False
        self._next_s = now + EVERY_S
        content, before = self._content(), self._before
        self._before = content
        if content is None or content != before or content == self._in_use:
            return False
        self._in_use = content
        if wrong := _wrong(self._tls):
            log.error("bus.tls: the renewed certificate is not taken: %s", wrong)
            return False
        log.info("bus.tls: the certificate was renewed; the hub is started anew with it")
        return True

    def _content(self) -> bytes | None:
        if self._tls is None:
            return None
        try:
            return hashlib.sha256(b"".join(file.read_bytes() for _, file in self._tls)).digest()
        except OSError:
            return None  # gone, or being replaced


def _wrong(tls: TlsConfig) -> str | None:
    """What is wrong with the files; None: a hub can begin with them."""
    try:
        x509.load_pem_x509_certificates(tls.ca.read_bytes())
        certificate = x509.load_pem_x509_certificates(tls.certificate.read_bytes())[0]
        key = load_pem_private_key(tls.key.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        return f"a file cannot be read ({error})"
    as_public = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    if key.public_key().public_bytes(*as_public) != certificate.public_key().public_bytes(*as_public):
        return f"{tls.key} is not the key of {tls.certificate}"
    return None
