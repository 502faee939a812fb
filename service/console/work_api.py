"""The API of long work and of priors on trial; everybody may look, engineers order and promote."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import anyio
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from lumpwatch.service.config import SiteConfig, UserRole, load_config
from lumpwatch.service.console.api import BadRequestError, answered, body_of
from lumpwatch.service.console.context import Context
from lumpwatch.service.console.guard import REPORT_POLICY, require
from lumpwatch.service.console.work import (
    Job,
    PriorDeed,
    act,
    check_order,
    listing,
    read_order,
    references,
    use_reference,
)
from lumpwatch.service.core import whole_number
from lumpwatch.service.storage import PriorStore, ReferenceStore

log = logging.getLogger(__name__)

_FILES = {
    "report.html": "text/html; charset=utf-8", "overlay.mp4": "video/mp4", "existence.png": "image/png",
    "backtest.json": "application/json", "backtest.png": "image/png", "lumps.csv": "text/csv; charset=utf-8",
    "summary.json": "application/json", "shadow.json": "application/json", "states.jsonl": "text/plain; charset=utf-8",
    "alarms.jsonl": "text/plain; charset=utf-8", "proposals.html": "text/html; charset=utf-8",
    "proposals.txt": "text/plain; charset=utf-8", "log.txt": "text/plain; charset=utf-8",
}  # fmt: skip
"""What may be fetched of a job, and as what."""


class WorkApi:
    """Jobs, priors, references."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._workshop = context.workshop
        store = context.config.store
        self._priors = PriorStore(store.path, store.keep_priors)
        self._references = ReferenceStore(store.path, store.keep_priors)

    def routes(self) -> list[Route]:
        """Its part of the application."""
        job, priors = "/api/v1/jobs/{job}", "/api/v1/cameras/{camera}/rois/{roi}/priors"
        return [
            Route("/api/v1/jobs", answered(self.jobs)),
            Route("/api/v1/jobs", answered(self.order), methods=["POST"]),
            Route(job, answered(self.job)),
            Route(job, answered(self.remove), methods=["DELETE"]),
            Route(f"{job}/cancel", answered(self.cancel), methods=["POST"]),
            Route(f"{job}/files/{{file}}", answered(self.file)),
            Route(priors, answered(self.priors)),
            Route(priors, answered(self.decide), methods=["POST"]),
            Route(f"{priors}/{{version}}/report", answered(self.report)),
            Route("/api/v1/cameras/{camera}/reference", answered(self.reference)),
            Route("/api/v1/cameras/{camera}/reference", answered(self.use_reference), methods=["POST"]),
        ]

    async def jobs(self, request: Request) -> Response:
        """All work, newest first."""
        found = await anyio.to_thread.run_sync(
            lambda: [self._shown(job) for job in self._workshop.queue.jobs()]
        )
        return JSONResponse({"jobs": found})

    async def order(self, request: Request) -> Response:
        """Order work: `kind` is train, suggest, replay, backtest or reference."""
        require(request, UserRole.ENGINEER)
        order = read_order(await body_of(request))
        user = request.scope["user"].name

        def put() -> Job:
            about = check_order(order, self._config(), self._workshop.library)
            return self._workshop.queue.put(order.kind, order.model_dump(mode="json"), about, user)

        return JSONResponse(self._shown(await anyio.to_thread.run_sync(put)), 202)

    async def job(self, request: Request) -> Response:
        """A job with the end of its log and the files that came of it."""
        name = request.path_params["job"]
        job = self._workshop.queue.job(name)

        def told() -> dict[str, Any]:
            folder = self._workshop.queue.folder(name)
            files = [file for file in _FILES if (folder / file).is_file()]
            return {**self._shown(job), "log": self._workshop.queue.log(name), "files": files}

        return JSONResponse(await anyio.to_thread.run_sync(told))

    async def cancel(self, request: Request) -> Response:
        """End a job, or keep it from beginning."""
        require(request, UserRole.ENGINEER)
        user = request.scope["user"].name
        return JSONResponse(self._shown(self._workshop.queue.cancel(request.path_params["job"], user)))

    async def remove(self, request: Request) -> Response:
        """Remove a job that is over, with what came of it."""
        require(request, UserRole.ENGINEER)
        await anyio.to_thread.run_sync(self._workshop.queue.remove, request.path_params["job"])
        return JSONResponse({})

    async def file(self, request: Request) -> Response:
        """A file that came of a job."""
        name = request.path_params["file"]
        path = self._workshop.queue.folder(request.path_params["job"]) / name
        if name not in _FILES or not path.is_file():
            raise KeyError(f"file {name[:40]}")
        return _sent(path, _FILES[name])

    async def priors(self, request: Request) -> Response:
        """All versions of a region's prior, the trial in shadow, and who did what."""
        camera, roi = self._region(request)

        def told() -> dict[str, Any]:
            deeds = self._workshop.deeds.latest(camera, roi)
            return {**listing(self._priors, camera, roi), "deeds": deeds}

        return JSONResponse(await anyio.to_thread.run_sync(told))

    async def decide(self, request: Request) -> Response:
        """Try a version in shadow, promote or drop it, or go back to one."""
        require(request, UserRole.ENGINEER)
        camera, roi = self._region(request)
        try:
            deed = PriorDeed.model_validate(await body_of(request))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise BadRequestError(f"{'.'.join(map(str, first['loc']))[:60]}: {first['msg']}") from error
        did = await anyio.to_thread.run_sync(act, self._priors, camera, roi, deed)
        return self._noted(request, did, camera, roi)

    async def report(self, request: Request) -> Response:
        """The report of the training that made a version."""
        camera, roi = self._region(request)
        version = whole_number(request.path_params["version"], 10**9)
        path = None if version is None else self._priors.report_path(camera, roi, version)
        if path is None or not path.is_file():
            raise KeyError("report of this version")
        return _sent(path, "text/html; charset=utf-8")

    async def reference(self, request: Request) -> Response:
        """What a fit picture of the camera looks like, and the stored versions."""
        camera = self._context.config.camera(request.path_params["camera"]).id
        return JSONResponse(await anyio.to_thread.run_sync(references, self._references, camera))

    async def use_reference(self, request: Request) -> Response:
        """Go back to a `version` of the reference."""
        require(request, UserRole.ENGINEER)
        camera = self._context.config.camera(request.path_params["camera"]).id
        version = (await body_of(request)).get("version")
        if type(version) is not int:
            raise BadRequestError("version: is not a whole number")
        did = await anyio.to_thread.run_sync(use_reference, self._references, camera, version)
        return self._noted(request, did, camera)

    def _noted(self, request: Request, did: str, camera: str, roi: str = "") -> Response:
        user = request.scope["user"].name
        log.warning("%s: %s/%s: %s", user, camera, roi, did)
        self._workshop.deeds.note(user, did, camera, roi)
        return JSONResponse({"did": did})

    def _config(self) -> SiteConfig:
        """As the file is now: that is what the work will read."""
        return load_config(self._context.path)

    def _shown(self, job: Job) -> dict[str, Any]:
        told: dict[str, Any] = job.model_dump(mode="json", exclude={"pid"})
        running = job.state == "running"
        return {**told, "progress": self._workshop.queue.progress(job.id) if running else None}

    def _region(self, request: Request) -> tuple[str, str]:
        camera, roi = request.path_params["camera"], request.path_params["roi"]
        self._context.config.camera(camera).roi(roi)
        return camera, roi


def _sent(path: Path, kind: str) -> Response:
    """A file; a page among them may show its own pictures and style, and nothing else."""
    headers = {"Cache-Control": "no-store"}
    if kind.startswith("text/html"):
        headers["Content-Security-Policy"] = REPORT_POLICY
    return FileResponse(path, media_type=kind, headers=headers)
