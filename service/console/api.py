"""The API under `/api/v1`: JSON, the same that the pages use; `openapi.json` describes it."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from functools import wraps
from typing import Any

import anyio
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from lumpwatch.service.console.context import Context
from lumpwatch.service.console.deeds import DeedError, do
from lumpwatch.service.console.guard import Guard, problem
from lumpwatch.service.console.openapi import openapi
from lumpwatch.service.core import whole_number
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import EvidenceError

Handler = Callable[[Request], Awaitable[Response]]
MOST_JSON = 1 << 20
_LONGEST_WAIT_S, _LOOK_S = 2.0, 0.02


class BadRequestError(LumpwatchError):
    """The body of a request is not what it must be."""


def answered(handler: Handler) -> Handler:
    """Errors as JSON with their status."""

    @wraps(handler)
    async def handle(request: Request) -> Response:
        try:
            return await handler(request)
        except DeedError as error:
            return problem(error.status, str(error))
        except PermissionError as error:
            return problem(403, str(error))
        except KeyError as error:
            return problem(404, f"{error.args[0]}: is not here")
        except BadRequestError as error:
            return problem(400, str(error))
        except EvidenceError as error:
            return problem(404, str(error))
        except LumpwatchError as error:
            return problem(422, str(error))

    return handle


async def body_of(request: Request, most: int = MOST_JSON) -> dict[str, Any]:
    """The JSON object in a request's body. Raises BadRequestError."""
    content = bytearray()
    async for piece in request.stream():
        content += piece
        if len(content) > most:
            raise BadRequestError(f"the body is larger than {most >> 10} KiB")
    try:
        found = json.loads(content) if content else {}
    except (ValueError, RecursionError):  # brackets by the thousand
        raise BadRequestError("the body is not JSON") from None
    if not isinstance(found, dict):
        raise BadRequestError("the body is not a JSON object")
    return found


def whole(request: Request, name: str, default: int) -> int:
    """A whole number among the query's parameters. Raises BadRequestError."""
    text = request.query_params.get(name, str(default))
    found = whole_number(text.removeprefix("-"), 10**14)
    if found is None:
        raise BadRequestError(f"{name}: is not a whole number")
    return -found if text.startswith("-") else found


class LiveApi:
    """States, pictures, alarms and evidence."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def routes(self) -> list[Route]:
        """Its part of the application."""
        region = "/api/v1/cameras/{camera}/rois/{roi}"
        return [
            Route("/api/v1/state", answered(self.state)),
            Route("/api/v1/stream", answered(self.stream)),
            Route("/api/v1/alarms", answered(self.alarms)),
            Route("/api/v1/me", answered(self.me)),
            Route("/api/v1/openapi.json", answered(self.described)),
            Route("/api/v1/cameras/{camera}/picture", answered(self.picture)),
            Route(f"{region}/existence", answered(self.existence)),
            Route(f"{region}/commands/{{name}}", answered(self.command), methods=["POST"]),
            Route(f"{region}/evidence", answered(self.evidence_list)),
            Route(f"{region}/evidence/{{id}}", answered(self.evidence)),
            Route(f"{region}/evidence/{{id}}/{{file}}", answered(self.evidence_file)),
        ]

    async def state(self, request: Request) -> Response:
        """Everything that the overview shows."""
        return JSONResponse(self._context.board.snapshot())

    async def stream(self, request: Request) -> Response:
        """The same as server-sent events."""
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        guard: Guard = request.app.state.guard
        return StreamingResponse(
            self._context.stream.events(lambda: guard.welcome(request)),
            media_type="text/event-stream",
            headers=headers,
        )

    async def alarms(self, request: Request) -> Response:
        """The latest alarm records, newest first."""
        return JSONResponse({"records": self._context.board.records(), "missed": self._context.board.missed})

    async def me(self, request: Request) -> Response:
        """Who asks, and what changes need in their header."""
        user, session = request.scope["user"], request.scope["session"]
        return JSONResponse(
            {"user": user.name, "role": user.role.label, "csrf": session.csrf if session else None}
        )

    async def described(self, request: Request) -> Response:
        """The API as an OpenAPI document."""
        return JSONResponse(openapi(request.app.routes))

    async def picture(self, request: Request) -> Response:
        """The newest picture that is not frame `after`; waits up to 2 s, then 204."""
        camera = request.path_params["camera"]
        self._context.config.camera(camera)
        after, waited = whole(request, "after", -1), 0.0
        while (shown := self._context.pictures.newest(camera, after)) is None:
            if waited >= _LONGEST_WAIT_S:
                return Response(status_code=204)
            await anyio.sleep(_LOOK_S)
            waited += _LOOK_S
        about = {
            "frame": shown.picture.frame,
            "size": [shown.picture.width, shown.picture.height],
            "states": {
                roi: {name: state.get(name) for name in ("state", "reason", "existence", "objects", "alarms")}
                for roi, state in shown.states.items()
            },
        }
        headers = {"X-Lumpwatch-Frame": json.dumps(about, separators=(",", ":"))}
        return Response(shown.picture.jpeg, media_type="image/jpeg", headers=headers)

    async def existence(self, request: Request) -> Response:
        """Existence over the last two minutes."""
        camera, roi = request.path_params["camera"], request.path_params["roi"]
        return JSONResponse({"points": self._context.board.curve(camera, roi)})

    async def command(self, request: Request) -> Response:
        """Do something to an alarm; the user is the actor."""
        camera, roi = self._region(request)
        given = await body_of(request)
        context = self._context
        reply = await anyio.to_thread.run_sync(
            do,
            context.bus,
            context.config.site,
            request.scope["user"],
            camera,
            roi,
            request.path_params["name"],
            given,
        )
        return JSONResponse(reply)

    async def evidence_list(self, request: Request) -> Response:
        """The evidence of a region, newest last."""
        camera, roi = self._region(request)
        newest = whole(request, "newest", 100)
        found = await anyio.to_thread.run_sync(self._context.clips.listing, camera, roi, newest)
        return JSONResponse({"evidence": found})

    async def evidence(self, request: Request) -> Response:
        """What a piece of evidence is."""
        camera, roi = self._region(request)
        return JSONResponse(
            await anyio.to_thread.run_sync(self._context.clips.meta, camera, roi, request.path_params["id"])
        )

    async def evidence_file(self, request: Request) -> Response:
        """Its still, its clip for browsers, or its curve."""
        camera, roi = self._region(request)
        name = request.path_params["file"]
        path = await anyio.to_thread.run_sync(
            self._context.clips.file, camera, roi, request.path_params["id"], name
        )
        return FileResponse(path, headers={"Cache-Control": "private, max-age=3600"})

    def _region(self, request: Request) -> tuple[str, str]:
        camera, roi = request.path_params["camera"], request.path_params["roi"]
        self._context.config.camera(camera).roi(roi)
        return camera, roi
