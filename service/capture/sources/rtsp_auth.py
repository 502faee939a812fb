"""HTTP authentication as RTSP cameras ask for it (RFC 7616 digest, RFC 7617 basic): what is offered, and the answer."""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass

_HASHES = {"MD5": "md5", "SHA-256": "sha256", "SHA-512-256": "sha512_256"}
_FFMPEG_KNOWS = frozenset({"BASIC", "MD5", "MD5-SESS"})
_PARAMETER = re.compile(r'([\w-]+)\s*=\s*(?:"((?:[^"\\]|\\.)*)"|([^\s,"]+))')
_MOST_SHOWN = 5


@dataclass(frozen=True, slots=True)
class Challenge:
    """One way in that a camera offers."""

    scheme: str
    """`BASIC` or `DIGEST`, or whatever it calls it."""
    parameters: dict[str, str]

    @property
    def algorithm(self) -> str:
        """`BASIC`, or of a digest, in capitals: `MD5` where it does not say."""
        return self.parameters.get("algorithm", "MD5").upper() if self.scheme == "DIGEST" else self.scheme

    @property
    def can(self) -> bool:
        """Whether it can be answered."""
        if self.scheme == "BASIC":
            return True
        known = self.scheme == "DIGEST" and self.algorithm.removesuffix("-SESS") in _HASHES
        return known and "nonce" in self.parameters and self._qop is not None

    @property
    def strength(self) -> int:
        """Larger is better."""
        return ("BASIC", "MD5", "SHA-256", "SHA-512-256").index(self.algorithm.removesuffix("-SESS"))

    @property
    def _qop(self) -> str | None:
        """`auth`, empty for none; None: only others are offered."""
        offered = [one.strip() for one in self.parameters.get("qop", "").split(",") if one.strip()]
        return "" if not offered else ("auth" if "auth" in offered else None)

    def answer(self, user: str, password: str, method: str, uri: str, count: int = 1) -> str:
        """The value of the header `Authorization`; `count` is how often the nonce was used, this time included."""
        if self.scheme == "BASIC":
            return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode()
        realm, nonce = self.parameters.get("realm", ""), self.parameters["nonce"]
        cnonce, turn, qop = secrets.token_hex(8), f"{count:08x}", self._qop
        secret = self._hash(f"{user}:{realm}:{password}")
        if self.algorithm.endswith("-SESS"):
            secret = self._hash(f"{secret}:{nonce}:{cnonce}")
        what = self._hash(f"{method}:{uri}")
        used = f"{nonce}:{turn}:{cnonce}:{qop}" if qop else nonce
        fields = [
            f'username="{user}"',
            f'realm="{realm}"',
            f'nonce="{nonce}"',
            f'uri="{uri}"',
            f'response="{self._hash(f"{secret}:{used}:{what}")}"',
        ]
        if "algorithm" in self.parameters:
            fields.append(f"algorithm={self.parameters['algorithm']}")
        if "opaque" in self.parameters:
            fields.append(f'opaque="{self.parameters["opaque"]}"')
        if qop or self.algorithm.endswith("-SESS"):
            fields += [f"qop={qop}"] * bool(qop) + [f"nc={turn}", f'cnonce="{cnonce}"']
        return "Digest " + ", ".join(fields)

    def _hash(self, text: str) -> str:
        return hashlib.new(_HASHES[self.algorithm.removesuffix("-SESS")], text.encode()).hexdigest()


def challenges(headers: Iterable[str]) -> tuple[Challenge, ...]:
    """What the values of the headers `WWW-Authenticate` offer, one challenge a header."""
    found = []
    for value in headers:
        scheme, _, rest = value.strip().partition(" ")
        pairs = {name.lower(): quoted or plain for name, quoted, plain in _PARAMETER.findall(rest)}
        found.append(Challenge(scheme.upper(), pairs))
    return tuple(found)


def best(offered: Iterable[Challenge]) -> Challenge | None:
    """The strongest that can be answered; None where none can."""
    return max((one for one in offered if one.can), key=lambda one: one.strength, default=None)


def needs_help(offered: Iterable[Challenge]) -> bool:
    """Whether FFmpeg may take a challenge that it cannot answer: of several it takes the last."""
    return any(one.algorithm not in _FFMPEG_KNOWS for one in offered) and best(offered) is not None


def in_words(offered: tuple[Challenge, ...]) -> str:
    """What is offered, for people: text of the camera's own is cut to what can be a name."""
    names = [one.algorithm if one.scheme != "DIGEST" else f"digest {one.algorithm}" for one in offered]
    return ", ".join(
        re.sub(r"[^\w. -]", "?", name)[:24].replace("BASIC", "basic") for name in names[:_MOST_SHOWN]
    )
