"""What stands between a browser and the pages: host names, headers, sessions, roles, and tokens against forgery.

Pure ASGI, so that streams pass through untouched.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lumpwatch.service.config import ConsoleConfig, UserRole
from lumpwatch.service.console.sessions import Session, Sessions
from lumpwatch.service.console.users import User, UserFile, UsersError

_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src 'self'; "
    "connect-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
)
REPORT_POLICY: Final = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'; sandbox"
)
"""Of reports, which hold their own style and pictures: no script, no form, nothing from outside, and no part of this
site."""
_HEADERS: Final = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
_SAFE = ("GET", "HEAD")
_OPEN = ("/login", "/static/")
TOKEN_HEADER: Final = "X-CSRF-Token"


class Guard:
    """The middleware; it puts `user` and `session` into the scope."""

    def __init__(
        self, app: ASGIApp, config: ConsoleConfig, sessions: Sessions, users: UserFile | None
    ) -> None:
        self._app = app
        self._config = config
        self._sessions = sessions
        self._users = users
        self._hosts = _hosts(config)

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers take `__Host-` by HTTPS only, and never from another host."""
        return "__Host-lumpwatch" if self._config.tls else "lumpwatch"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or answer it."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        request = Request(scope)
        session = self._sessions.find(_cookie(request.headers, self.cookie))
        given = None if session is not None else self._sessions.begin(None) if _page(request) else None
        session = session or given
        try:
            user = self._user(request, session)
        except UsersError:
            user = None  # a file that cannot be read lets nobody in
        scope["session"], scope["user"] = session, user
        refused = self._refusal(request, session, user)

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    if headers.get(name) != REPORT_POLICY:
                        headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
                if self._config.tls:
                    headers["Strict-Transport-Security"] = "max-age=31536000"
                if given is not None:
                    headers.append("Set-Cookie", self.set_cookie(given))
            await send(message)

        await (refused or self._app)(scope, receive, sending)

    def welcome(self, request: HTTPConnection) -> bool:
        """Whether who asked is still known: a login may end, and users be removed, while an answer goes on."""
        try:
            return self._user(request, self._sessions.find(_cookie(request.headers, self.cookie))) is not None
        except UsersError:
            return False

    def set_cookie(self, session: Session) -> str:
        """The header that hands a session to the browser."""
        secure = "; Secure" if self._config.tls else ""
        return f"{self.cookie}={session.token}; Path=/; HttpOnly; SameSite=Strict{secure}"

    def _user(self, request: HTTPConnection, session: Session | None) -> User | None:
        if self._config.proxy is not None and (named := self._from_proxy(request)) is not None:
            return named
        if session is not None and session.user is not None and self._users is not None:
            # As the file has it now: who was removed is out at once.
            return self._users.find(session.user.name)
        visitor = self._config.visitor
        return User("console", visitor) if visitor is not None else None

    def _from_proxy(self, request: HTTPConnection) -> User | None:
        proxy = self._config.proxy
        if proxy is None or request.client is None or request.client.host not in proxy.trusted:
            return None
        name = " ".join(request.headers.get(proxy.user_header, "").split())[:64]
        if not name:
            return None
        groups = {group.strip() for group in request.headers.get(proxy.groups_header, "").split(",")}
        role = UserRole.VIEWER
        if groups & set(proxy.operators):
            role = UserRole.OPERATOR
        if groups & set(proxy.engineers):
            role = UserRole.ENGINEER
        return User(name, role)

    def _refusal(self, request: Request, session: Session | None, user: User | None) -> Response | None:
        if self._hosts is not None and _host(request.headers.get("host", "")) not in self._hosts:
            return problem(421, "this console is not known by that name (console.names)")
        path = request.url.path
        if request.method not in _SAFE:
            origin = request.headers.get("origin")
            if origin is not None and origin.partition("://")[2] != request.headers.get("host"):
                return problem(403, "the request comes from another page")
            if path != "/login":
                token = request.headers.get(TOKEN_HEADER, "")
                if session is None or not hmac.compare_digest(token.encode(), session.csrf.encode()):
                    return problem(
                        403, f"{TOKEN_HEADER}: is missing or of another session; load the page again"
                    )
        if user is None and not path.startswith(_OPEN):
            if path.startswith("/api/"):
                return problem(401, "log in first")
            return RedirectResponse("/login", 303)
        return None


def problem(status: int, text: str) -> JSONResponse:
    """An error as the API words it."""
    return JSONResponse({"error": text}, status)


def require(request: Request, role: UserRole) -> None:
    """Raise PermissionError where the user may not."""
    user: User = request.scope["user"]
    if user.role < role:
        raise PermissionError(f"this needs the role {role.label}, and {user.name} is {user.role.label}")


def guarded(config: ConsoleConfig, sessions: Sessions, users: UserFile | None) -> Callable[[ASGIApp], Guard]:
    """The middleware as a function of the application."""

    def wrap(app: ASGIApp) -> Guard:
        return Guard(app, config, sessions, users)

    return wrap


def _page(request: Request) -> bool:
    """Whether a session is begun for a request without one: for pages, not for files and programs."""
    path = request.url.path
    return request.method == "GET" and not path.startswith(("/static/", "/api/"))


def _cookie(headers: Headers, name: str) -> str | None:
    try:
        found: Any = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return None
    return None if found is None else str(found.value)


def _hosts(config: ConsoleConfig) -> frozenset[str] | None:
    """The names by which the console may be called; None: all. On loopback this keeps out rebound names."""
    host = config.address[0]
    if config.loopback:
        return frozenset({"localhost", "127.0.0.1", "::1", host, *config.names})
    if host in ("0.0.0.0", "::", "*") and not config.names:
        return None
    return frozenset({host, *config.names})


def _host(header: str) -> str:
    if header.startswith("["):
        return header[1:].partition("]")[0]
    return header.partition(":")[0].lower()
