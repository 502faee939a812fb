"""The API of the regions: what the file says, a change as a difference, and the change itself; for engineers."""

from __future__ import annotations

import logging

import anyio
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lumpwatch.service.config import UserRole
from lumpwatch.service.console.api import BadRequestError, answered, body_of
from lumpwatch.service.console.context import Context
from lumpwatch.service.console.editing import ConflictError, Proposal, propose, region_of, write
from lumpwatch.service.console.guard import problem, require

log = logging.getLogger(__name__)


class EditApi:
    """Changes of regions."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._one = anyio.Lock()

    def routes(self) -> list[Route]:
        """Its part of the application."""
        region = "/api/v1/cameras/{camera}/rois/{roi}/region"
        return [
            Route(region, answered(self.read)),
            Route(f"{region}/preview", answered(self.preview), methods=["POST"]),
            Route(region, answered(self.change), methods=["POST"]),
        ]

    async def read(self, request: Request) -> Response:
        """The region as the file has it."""
        where = request.path_params["camera"], request.path_params["roi"]
        return JSONResponse(await anyio.to_thread.run_sync(region_of, self._context.path, *where))

    async def preview(self, request: Request) -> Response:
        """What a change would do to the file; nothing is written."""
        proposal = await self._proposed(request)
        if isinstance(proposal, Response):
            return proposal
        return JSONResponse({"diff": proposal.diff, "fit": proposal.fit})

    async def change(self, request: Request) -> Response:
        """Write it; a running daemon starts the camera anew with it."""
        async with self._one:
            proposal = await self._proposed(request)
            if isinstance(proposal, Response):
                return proposal
            user = request.scope["user"]
            kept = await anyio.to_thread.run_sync(write, self._context.path, proposal, user.name)
        log.warning("%s changed %s; the old one is %s", user.name, self._context.path, kept.name)
        return JSONResponse({"diff": proposal.diff, "fit": proposal.fit, "kept": kept.name})

    async def _proposed(self, request: Request) -> Proposal | Response:
        require(request, UserRole.ENGINEER)
        camera, roi = request.path_params["camera"], request.path_params["roi"]
        self._context.config.camera(camera).roi(roi)
        given = await body_of(request)
        size = given.get("size")
        if (
            not isinstance(size, list)
            or len(size) != 2
            or not all(type(v) is int and 0 < v < 20_000 for v in size)
        ):
            raise BadRequestError("size: is not width and height of the picture")
        try:
            return await anyio.to_thread.run_sync(
                propose, self._context.path, camera, roi, given, (size[0], size[1])
            )
        except ConflictError as error:
            return problem(409, str(error))
