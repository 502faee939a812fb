"""Where a camera's frames come from."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Literal, Self
from urllib.parse import quote, urlsplit

from pydantic import Field, SecretStr, field_validator, model_validator

from lumpwatch.service.config.base import NotNegative, Positive, PositiveSeconds, Strict

SourceKind = Literal["rtsp", "video", "images", "simulated"]
Levels = Literal["auto", "limited", "full"]
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def redact(url: str) -> str:
    """The URL with user, password, query, fragment and values in the path replaced, fit for logs and metrics.

    Passwords may hold any character, so everything up to the last @ is hidden.
    """
    scheme, separator, rest = url.partition("://")
    if not separator:
        return url
    secret, at, place = rest.rpartition("@")
    if odd := re.search(r"[?#;&=]", place):
        # Cameras take passwords in the query and in the path (`/user=…&password=…`) as well.
        end = odd.start() if odd[0] in "?#;" else place.rfind("/", 0, odd.start()) + 1
        place = f"{place[:end]}?***"
    return f"{scheme}://{'***@' if secret or at else ''}{place}"


def encoded(url: str) -> str:
    """An RTSP URL with user and password percent-encoded; what is encoded already stays as it is.

    `/ ? # @ %` may stand in a password as they are: the last @ before the host ends it.
    """
    scheme, separator, rest = url.partition("://")
    secret, place = _taken_apart(rest)
    if scheme.lower() not in ("rtsp", "rtsps") or not separator or secret is None:
        return url
    user, colon, password = secret.partition(":")
    return f"{scheme}://{_quoted(user)}{colon}{_quoted(password)}@{place}"


def _taken_apart(rest: str) -> tuple[str | None, str]:
    """User and password, where there are, and what comes behind them."""
    authority, slash, path = rest.partition("/")
    if "@" in authority:
        secret, _, host = authority.rpartition("@")
        return secret, f"{host}{slash}{path}"
    name = authority.partition(":")[0]
    is_host = ":" not in authority or "." in name or name.startswith("[") or name == "localhost"
    if is_host or "@" not in path:
        return None, rest
    secret, _, place = rest.rpartition("@")  # a slash in the password
    return secret, place


def _quoted(text: str) -> str:
    if re.search(r"%(?![0-9A-Fa-f]{2})", text):
        text = text.replace("%", "%25")
    return quote(text, safe="%!$&'()*+,;=-._~")


class BackoffConfig(Strict):
    """Exponential back-off with jitter between attempts to connect; it never gives up."""

    initial_s: PositiveSeconds = 0.5
    """First pause."""
    max_s: PositiveSeconds = 30.0
    """Longest pause."""
    jitter: float = Field(default=0.2, ge=0.0, le=1.0)
    """Share of a pause that is drawn at random, so that cameras do not reconnect in step."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max_s < self.initial_s:
            raise ValueError(
                f"max_s ({self.max_s:g}) must not be smaller than initial_s ({self.initial_s:g})"
            )
        return self


class CameraTlsConfig(Strict):
    """Whom a camera's certificate must be signed by (`rtsps` only)."""

    ca: Path | None = None
    """File of the authorities' certificates, PEM; relative paths begin at the configuration file. Left out: those of
    the system."""
    insecure: bool = False
    """Take any certificate: whoever stands in between reads the password and shows what pictures he likes."""

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.insecure and self.ca is not None:
            raise ValueError("ca and insecure contradict each other")
        return self


class SourceConfig(Strict):
    """One source of frames: an RTSP stream, a video file, a folder of images, or the simulated feed."""

    url: SecretStr
    """`rtsp://…`, a path to a video file or a folder of images, or `sim:feed?lumps_per_minute=8`. A relative path
    counts from the working directory, and from the configuration's folder where only there is such a file."""
    transport: Literal["tcp", "udp"] = "tcp"
    """How RTP travels (RTSP only)."""
    tls: CameraTlsConfig = CameraTlsConfig()
    """Of an `rtsps` address: the certificate is verified."""
    open_timeout_s: PositiveSeconds = 5.0
    """A connection that has not opened by then is a fault (`open_timeout`)."""
    read_timeout_s: PositiveSeconds = 5.0
    """No frame for this long is a fault (`read_timeout`)."""
    key_frame_timeout_s: PositiveSeconds = 30.0
    """So long a key frame is waited for while data comes (RTSP only): no picture can be decoded before it."""
    max_age_s: PositiveSeconds = 2.0
    """A frame that arrives later than this after its capture is dropped and counted (`stale`)."""
    backoff: BackoffConfig = BackoffConfig()
    """Pauses between attempts to connect."""
    pace: bool = True
    """Play files at their own speed; false: as fast as they are read."""
    loop: bool = False
    """Start a file again at its end instead of ending."""
    fps: Positive | None = None
    """Frame rate of a folder of images (default 10) or of the simulated feed (default 15)."""
    seed: int = Field(default=0, ge=0)
    """Seed of the simulated feed."""
    levels: Levels = "auto"
    """Range of the grey levels in videos and streams: `limited` (black is 16, white 235) is put into full range.
    `auto`: as the stream says; one that says nothing is taken as it is."""
    start_s: NotNegative = 0.0
    """Skip this much of a file."""

    @field_validator("url")
    @classmethod
    def _named(cls, value: SecretStr) -> SecretStr:
        url = value.get_secret_value()
        if not url.strip():
            raise ValueError("url is empty")
        scheme = url.partition(":")[0].lower()
        if "://" in url and scheme not in ("rtsp", "rtsps", "file"):
            raise ValueError(f"url scheme '{scheme}' is not supported (rtsp, rtsps, file, sim: or a path)")
        if "://" not in url and re.match(r"[^/]*:[^/]*@", url):
            raise ValueError("url looks like an address without its scheme (rtsp://…)")
        if scheme in ("rtsp", "rtsps"):
            try:
                host = urlsplit(encoded(url)).hostname
            except ValueError as error:
                raise ValueError("url is not a valid RTSP address") from error
            if not host:
                raise ValueError("url names no host")
        return value

    @model_validator(mode="after")
    def _tls_of_rtsps(self) -> Self:
        secure = self.url.get_secret_value().lower().startswith("rtsps://")
        if self.tls != CameraTlsConfig() and not secure:
            raise ValueError("tls is for rtsps:// addresses")
        return self

    def under(self, folder: Path) -> SourceConfig:
        """The same with the authorities' file taken from `folder`, and a film or folder that is only there."""
        changed: dict[str, object] = {}
        if self.tls.ca is not None:
            changed["tls"] = CameraTlsConfig(ca=folder / self.tls.ca)
        if self.kind in ("video", "images"):
            beside = folder / self.path
            # os.path answers False where a folder on the way may not be read, and for what no path can be.
            if not os.path.exists(self.path) and os.path.exists(beside):  # noqa: PTH110
                changed["url"] = SecretStr(str(beside))
        return self.model_copy(update=changed)

    @property
    def longest_silence_s(self) -> float:
        """The longest that opening and reading can take without a frame or a fault."""
        wait_s = (
            max(self.read_timeout_s, self.key_frame_timeout_s) if self.kind == "rtsp" else self.read_timeout_s
        )
        return self.open_timeout_s + wait_s

    @property
    def address(self) -> str:
        """The URL as FFmpeg wants it: user and password percent-encoded, whatever characters they were given in."""
        return encoded(self.url.get_secret_value())

    @property
    def redacted(self) -> str:
        """The URL without credentials."""
        return redact(self.url.get_secret_value())

    @property
    def path(self) -> Path:
        """The file or folder, for sources that are one."""
        return Path(self.url.get_secret_value().removeprefix("file://"))

    @property
    def kind(self) -> SourceKind:
        """Which source the URL means; a path that ends in no known picture suffix is a video."""
        url = self.url.get_secret_value()
        if url.lower().startswith(("rtsp://", "rtsps://")):
            return "rtsp"
        if url.startswith("sim:"):
            return "simulated"
        # os.path answers False where a folder on the way may not be read; the source then names that fault.
        return "images" if os.path.isdir(self.path) else "video"  # noqa: PTH112
