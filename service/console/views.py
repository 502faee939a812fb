"""The pages: HTML by the server, which JavaScript modules fill with what comes over the API."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any
from urllib.parse import parse_qs, urlencode

import anyio
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from lumpwatch.service.config import UserRole, load_config
from lumpwatch.service.console.context import Context
from lumpwatch.service.console.guard import Guard, problem
from lumpwatch.service.console.reports import as_csv, by_hour, events, shift
from lumpwatch.service.console.trends import hours_of, trends
from lumpwatch.service.console.users import User, UsersError
from lumpwatch.service.errors import LumpwatchError

_MOST_FORM = 4096
NAV = (
    ("/", "Overview", "overview"),
    ("/alarms", "Alarms", "alarms"),
    ("/events", "Events", "events"),
    ("/shift", "Shift", "shift"),
    ("/trends", "Trends", "trends"),
    ("/health", "Health", "health"),
)
"""Pages in the header: address, text, name."""
_HASHES = 2


class Views:
    """All pages."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._hashes = anyio.Semaphore(_HASHES)  # 32 MiB and 0.1 s each

    def routes(self) -> list[Route]:
        """Their part of the application."""
        return [
            Route("/", self.overview),
            Route("/login", self.login),
            Route("/login", self.log_in, methods=["POST"]),
            Route("/logout", self.log_out, methods=["POST"]),
            Route("/cameras/{camera}", self.live),
            Route("/alarms", self.alarms),
            Route("/evidence/{camera}/{roi}/{id}", self.evidence),
            Route("/events", self.events),
            Route("/api/v1/events", self.events_json),
            Route("/api/v1/events.csv", self.events_csv),
            Route("/shift", self.shift),
            Route("/trends", self.trends),
            Route("/api/v1/trends", self.trends_json),
            Route("/health", self.health),
            Route("/regions/{camera}/{roi}", self.regions),
            Route("/clips", self.clips),
            Route("/clips/{clip}", self.label),
            Route("/training/{camera}/{roi}", self.training),
            Route("/jobs/{job}", self.job),
        ]

    def page(self, request: Request, name: str, status: int = 200, **values: object) -> Response:
        """A page of `pages/`."""
        user: User | None = request.scope["user"]
        session = request.scope["session"]
        config = self._context.config
        text = self._context.templates.get_template(f"{name}.html").render(
            site=config.site,
            cameras=config.cameras,
            user=user,
            may_operate=user is not None and user.role >= UserRole.OPERATOR,
            may_change=user is not None and user.role >= UserRole.ENGINEER,
            can_log_in=self._context.users is not None,
            csrf=session.csrf if session else "",
            page=name,
            nav=self._nav(user),
            times=self._context.times,
            **values,
        )
        return HTMLResponse(text, status)

    def _nav(self, user: User | None) -> list[tuple[str, str, str]]:
        camera = self._context.config.cameras[0]
        links = [NAV[0], (f"/cameras/{camera.id}", "Live", "live"), *NAV[1:]]
        if user is not None and user.role >= UserRole.ENGINEER:
            region = f"{camera.id}/{camera.rois[0].id}"
            links.append((f"/regions/{region}", "Regions", "regions"))
            links.append(("/clips", "Clips", "clips"))
            links.append((f"/training/{region}", "Training", "training"))
        return links

    async def overview(self, request: Request) -> Response:
        """All regions, worst first."""
        return self.page(request, "overview")

    async def live(self, request: Request) -> Response:
        """One camera."""
        try:
            config = await anyio.to_thread.run_sync(
                load_config, self._context.path
            )  # engineers may have changed it
        except LumpwatchError:
            config = self._context.config
        try:
            camera = config.camera(request.path_params["camera"])
        except KeyError:
            return self.missing(request)
        shape = {
            roi.id: {
                "polygon": roi.polygon,
                "lip": roi.calibration.lip if roi.calibration else None,
                "limit_mm": roi.calibration.limit_mm if roi.calibration else None,
                "raise_above": roi.alarm.raise_above,
            }
            for roi in camera.rois
        }
        return self.page(request, "live", camera=camera, shape=shape)

    async def alarms(self, request: Request) -> Response:
        """The list of alarms."""
        return self.page(request, "alarms")

    async def evidence(self, request: Request) -> Response:
        """A clip with its curve, and the verdict."""
        names = {name: request.path_params[name] for name in ("camera", "roi", "id")}
        try:
            self._context.config.camera(names["camera"]).roi(names["roi"])
        except KeyError:
            return self.missing(request)
        return self.page(request, "evidence", where=names)

    async def events(self, request: Request) -> Response:
        """The event log."""
        asked = {
            name: request.query_params.get(name, "")[:128] for name in ("since", "camera", "class", "actor")
        }
        rows: list[dict[str, Any]] = []
        error = ""
        try:
            rows = await anyio.to_thread.run_sync(events, self._context.config, asked)
        except LumpwatchError as problem_found:
            error = str(problem_found)
        return self.page(request, "events", rows=rows[:500], error=error, asked=asked, query=urlencode(asked))

    async def events_json(self, request: Request) -> Response:
        """The same for programs."""
        try:
            rows = await anyio.to_thread.run_sync(events, self._context.config, dict(request.query_params))
        except LumpwatchError as error:
            return problem(422, str(error))
        return JSONResponse({"events": rows})

    async def events_csv(self, request: Request) -> Response:
        """The same for spreadsheets."""
        try:
            rows = await anyio.to_thread.run_sync(events, self._context.config, dict(request.query_params))
        except LumpwatchError as error:
            return problem(422, str(error))
        headers = {"Content-Disposition": 'attachment; filename="events.csv"'}
        return Response(as_csv(rows), media_type="text/csv; charset=utf-8", headers=headers)

    async def shift(self, request: Request) -> Response:
        """The figures of a shift."""
        when = request.query_params.get("when", "current")[:80]
        figures, error, hours = None, "", [0]
        try:
            figures = await anyio.to_thread.run_sync(shift, self._context.config, when)
            hours = by_hour(figures)
        except LumpwatchError as problem_found:
            error = str(problem_found)
        return self.page(
            request, "shift", figures=figures, error=error, when=when, hours=hours, most=max(1, *hours)
        )

    async def trends(self, request: Request) -> Response:
        """Lumps, sizes, blind time and age of decisions, hour by hour."""
        hours, rows, error = request.query_params.get("hours", "24")[:20], [], ""
        try:
            rows = await self._trends(hours)
        except LumpwatchError as problem_found:
            error = str(problem_found)
        return self.page(request, "trends", rows=rows, error=error, hours=hours)

    async def trends_json(self, request: Request) -> Response:
        """The same for programs."""
        try:
            rows = await self._trends(request.query_params.get("hours", "24")[:20])
        except LumpwatchError as error:
            return problem(422, str(error))
        return JSONResponse(
            {"regions": [{**row, "hours": [asdict(hour) for hour in row["hours"]]} for row in rows]}
        )

    async def _trends(self, hours: str) -> list[dict[str, Any]]:
        context = self._context
        return await anyio.to_thread.run_sync(
            trends, context.config, hours_of(hours), time.time(), context.board.age
        )

    async def health(self, request: Request) -> Response:
        """Each stage from camera to alarm."""
        return self.page(request, "health")

    async def regions(self, request: Request) -> Response:
        """The editor of a region."""
        try:
            camera = self._context.config.camera(request.path_params["camera"])
            roi = camera.roi(request.path_params["roi"])
        except KeyError:
            return self.missing(request)
        return self._for_engineers(request, "regions", camera=camera, roi=roi)

    async def clips(self, request: Request) -> Response:
        """Clips: recorded, uploaded, labelled."""
        return self._for_engineers(request, "clips")

    async def label(self, request: Request) -> Response:
        """The labels of a clip."""
        try:
            about = self._context.workshop.library.about(request.path_params["clip"])
        except KeyError:
            return self.missing(request)
        return self._for_engineers(request, "label", clip=about)

    async def training(self, request: Request) -> Response:
        """Training, and what comes of it."""
        try:
            camera = self._context.config.camera(request.path_params["camera"])
            roi = camera.roi(request.path_params["roi"])
        except KeyError:
            return self.missing(request)
        return self._for_engineers(request, "training", camera=camera, roi=roi)

    async def job(self, request: Request) -> Response:
        """A piece of work and its results."""
        try:
            job = self._context.workshop.queue.job(request.path_params["job"])
        except KeyError:
            return self.missing(request)
        return self._for_engineers(request, "job", job=job)

    def _for_engineers(self, request: Request, name: str, **values: Any) -> Response:
        if request.scope["user"].role < UserRole.ENGINEER:
            return self.page(request, "missing", 403)
        return self.page(request, name, **values)

    def missing(self, request: Request) -> Response:
        """What is not there."""
        return self.page(request, "missing", 404)

    async def login(self, request: Request) -> Response:
        """Name and password."""
        if self._context.users is None:
            return RedirectResponse("/", 303) if request.scope["user"] else self.missing(request)
        return self.page(request, "login", error="")

    async def log_in(self, request: Request) -> Response:
        """Judge name and password; a new session for who may come in."""
        users, session = self._context.users, request.scope["session"]
        if users is None:
            return problem(404, "this console has no users of its own")
        content = bytearray()
        async for piece in request.stream():
            content += piece
            if len(content) > _MOST_FORM:
                return problem(413, "the form is too large")
        form = parse_qs(content.decode("utf-8", "replace"), max_num_fields=8)
        name, password, token = (form.get(field, [""])[0] for field in ("name", "password", "csrf"))
        if session is None or token != session.csrf:
            return RedirectResponse("/login", 303)
        address = request.client.host if request.client else ""
        who = (f"name {name[:64]}", f"address {address}")
        if (wait_s := self._context.throttle.wait_s(*who)) > 0:
            text = f"Too many attempts. Try again in {wait_s:.0f} s."
            return self.page(request, "login", 429, error=text)
        try:
            async with self._hashes:
                user = await anyio.to_thread.run_sync(users.check, name, password)
        except UsersError:
            return self.page(request, "login", 503, error="The file of users cannot be read.")
        if user is None:
            self._context.throttle.failed(*who)
            return self.page(request, "login", 401, error="Name or password is wrong.")
        self._context.throttle.succeeded(*who)
        self._context.sessions.end(session.token)
        answer = RedirectResponse("/", 303)
        guard: Guard = request.app.state.guard
        answer.headers.append("Set-Cookie", guard.set_cookie(self._context.sessions.begin(user)))
        return answer

    async def log_out(self, request: Request) -> Response:
        """End the session."""
        if request.scope["session"] is not None:
            self._context.sessions.end(request.scope["session"].token)
        return Response(status_code=204)
