"""Opening an RTSP address with FFmpeg: certificates verified, and the challenges that it cannot answer answered."""

from __future__ import annotations

import ssl
from collections.abc import Callable
from pathlib import Path

import av
from av import FFmpegError
from av.container import InputContainer

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.faults import fault_of, source_error
from lumpwatch.service.capture.sources.rtsp_auth import in_words, needs_help
from lumpwatch.service.capture.sources.rtsp_relay import Place, RtspRelay, connect, offered, place_of
from lumpwatch.service.config import SourceConfig

# How long a gap in UDP packets is waited for.
_REORDER_US = 100_000
# Connecting and probing have a time-out each.
_OPEN_PHASES = 2


class RtspOpener:
    """Opens one address again and again; remembers that the camera needs help."""

    def __init__(self, config: SourceConfig, name: str, monotonic: Callable[[], float]) -> None:
        self._config, self._name, self._monotonic = config, name, monotonic
        self._relay: RtspRelay | None = None

    def open(self, read_timeout_s: float) -> InputContainer:
        """Connect and probe; raises SourceError."""
        self.close()
        address = self._config.address
        try:
            return self._opened(address, read_timeout_s)
        except SourceError as error:
            failure = error
        try:
            failure = self._explained(failure, place_of(address))
        except ssl.SSLCertVerificationError as error:
            words = error.verify_message.lower()
            failure = SourceError(
                Fault.CERTIFICATE, f"{self._name}: the camera's certificate is refused: {words}"
            )
        except (OSError, ValueError):
            pass  # it cannot be asked why: what FFmpeg said stands
        if self._relay is None:
            raise failure from None
        return self._opened(self._relay.address, read_timeout_s)

    def close(self) -> None:
        """Let go of what helped; idempotent."""
        if self._relay is not None:
            self._relay.close()
            self._relay = None

    def _opened(self, address: str, read_timeout_s: float) -> InputContainer:
        limit = self._config.open_timeout_s / _OPEN_PHASES
        start = self._monotonic()
        try:
            return av.open(
                address,
                options=self._options(address),
                timeout=(limit, read_timeout_s),
                metadata_errors="replace",  # names of sessions may be in any encoding
            )
        except FFmpegError as error:
            # An interrupted open is reported as invalid data as well.
            late = self._monotonic() - start >= limit
            fault = fault_of(error, Fault.OPEN_TIMEOUT if late else Fault.UNREACHABLE)
            failure = source_error(self._name, fault, error)
        raise failure

    def _options(self, address: str) -> dict[str, str]:
        options = {
            "rtsp_transport": self._config.transport,
            "allowed_media_types": "video",
            "fpsprobesize": "0",
            "max_delay": str(_REORDER_US),
        }
        if address.lower().startswith("rtsps://"):
            tls = self._config.tls
            options["tls_verify"] = "0" if tls.insecure else "1"
            if (trusted := _trusted(tls.ca)) is not None:
                options["ca_file"] = trusted
        return options

    def _explained(self, failure: SourceError, place: Place) -> SourceError:
        """The failure in better words; where a relay helps it is there afterwards.

        Raises ssl.SSLCertVerificationError, OSError and ValueError.
        """
        wait_s = self._config.open_timeout_s / _OPEN_PHASES
        context = self._context() if place.scheme == "rtsps" else None
        if failure.fault is Fault.UNREACHABLE and context is not None:
            connect(place, context, wait_s).close()
        if failure.fault is not Fault.UNAUTHORISED:
            return failure
        ways = offered(place, context, wait_s)
        if place.user and needs_help(ways) and self._config.transport == "tcp":
            self._relay = RtspRelay(place, context, wait_s)
            return failure
        if not ways:
            return failure
        what = f"the camera offers {in_words(ways)}"
        if place.user and needs_help(ways):
            what += "; this needs transport: tcp"
        words = "user or password refused" if place.user else "asks for user and password"
        return SourceError(Fault.UNAUTHORISED, f"{self._name}: {words} ({what})")

    def _context(self) -> ssl.SSLContext:
        tls = self._config.tls
        context = ssl.create_default_context(cafile=None if tls.ca is None else str(tls.ca))
        if tls.insecure:
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return context


def _trusted(ca: Path | None) -> str | None:
    """The file of authorities: the system's where none is given. FFmpeg's wheel brings none of its own."""
    if ca is not None:
        return str(ca)
    paths = ssl.get_default_verify_paths()
    elsewhere = ("/etc/ssl/certs/ca-certificates.crt", "/etc/pki/tls/certs/ca-bundle.crt")
    usual = (paths.cafile, paths.openssl_cafile, *elsewhere)
    return next((path for path in usual if path and Path(path).is_file()), None)
