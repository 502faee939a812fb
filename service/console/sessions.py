"""Who is logged in, and how often a login may be tried. In memory: a restart of the console logs everyone out."""

from __future__ import annotations

import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from lumpwatch.service.console.users import User

_MOST_SESSIONS = 1000
_MOST_TRIES = 10_000
_FREE_TRIES = 5
_LONGEST_S = 300.0
_FORGET_S = 3600.0


@dataclass(frozen=True, slots=True)
class Session:
    """A browser; `user` is None before it has logged in."""

    token: str
    csrf: str
    """What a request that changes something must bring along, beside the cookie."""
    user: User | None
    ends_s: float


class Sessions:
    """All sessions; their tokens are random, and the oldest goes when there are too many.

    Those without a user are counted apart: whoever calls the login page again and again logs nobody out.
    """

    def __init__(self, lasts_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._lasts_s = lasts_s
        self._clock = clock
        self._known: OrderedDict[str, Session] = OrderedDict()
        self._unknown: OrderedDict[str, Session] = OrderedDict()

    def begin(self, user: User | None) -> Session:
        """A new session, with a token that nobody has had before."""
        session = Session(
            secrets.token_urlsafe(32), secrets.token_urlsafe(32), user, self._clock() + self._lasts_s
        )
        among = self._unknown if user is None else self._known
        among[session.token] = session
        while len(among) > _MOST_SESSIONS:
            among.popitem(last=False)
        return session

    def find(self, token: str | None) -> Session | None:
        """The session of a cookie; None where there is none, or it is over."""
        session = self._known.get(token or "") or self._unknown.get(token or "")
        if session is not None and self._clock() >= session.ends_s:
            self.end(session.token)
            return None
        return session

    def end(self, token: str) -> None:
        """Forget a session."""
        self._known.pop(token, None)
        self._unknown.pop(token, None)


class Throttle:
    """After five failures in a row each further try of the same name or address waits twice as long as the last."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failed: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_s(self, *who: str) -> float:
        """Seconds until the next try may be made; 0: now."""
        return max(0.0, *(self._wait_s(one) for one in who))

    def failed(self, *who: str) -> None:
        """A try has failed."""
        now = self._clock()
        for one in who:
            count, last_s = self._failed.pop(one, (0, now))
            self._failed[one] = (1 if now - last_s > _FORGET_S else count + 1, now)
        while len(self._failed) > _MOST_TRIES:
            self._failed.popitem(last=False)

    def succeeded(self, *who: str) -> None:
        """Forget the failures."""
        for one in who:
            self._failed.pop(one, None)

    def _wait_s(self, who: str) -> float:
        count, last_s = self._failed.get(who, (0, 0.0))
        if count < _FREE_TRIES:
            return 0.0
        return last_s + min(_LONGEST_S, 2.0 ** min(count - _FREE_TRIES, 30)) - self._clock()
