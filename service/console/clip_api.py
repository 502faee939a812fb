"""The API of clips and their labels; everybody may look, engineers change."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import anyio
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lumpwatch.service.bus import Keys
from lumpwatch.service.config import UserRole
from lumpwatch.service.console.api import BadRequestError, answered, body_of, whole
from lumpwatch.service.console.context import Context
from lumpwatch.service.console.guard import problem, require
from lumpwatch.service.console.work import (
    About,
    ClipError,
    Kept,
    LabelConflictError,
    Labels,
    Recording,
    from_boxes,
    to_mot,
)
from lumpwatch.service.core import whole_number
from lumpwatch.service.storage import read_labels

_MOST_LABELS = 16 << 20
_MOST_SECONDS = 1800


class ClipApi:
    """Clips and labels."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._library = context.workshop.library

    def routes(self) -> list[Route]:
        """Its part of the application."""
        clip = "/api/v1/clips/{clip}"
        return [
            Route("/api/v1/clips", answered(self.clips)),
            Route("/api/v1/clips", answered(self.upload), methods=["POST"]),
            Route("/api/v1/cameras/{camera}/recording", answered(self.recording)),
            Route("/api/v1/cameras/{camera}/recording", answered(self.record), methods=["POST"]),
            Route("/api/v1/cameras/{camera}/recording", answered(self.stop), methods=["DELETE"]),
            Route(clip, answered(self.clip)),
            Route(clip, answered(self.remove), methods=["DELETE"]),
            Route(f"{clip}/frames/{{number:int}}.jpg", answered(self.frame)),
            Route(f"{clip}/labels", answered(self.label), methods=["POST"]),
            Route(f"{clip}/labels.txt", answered(self.export)),
            Route(f"{clip}/labels.txt", answered(self.take), methods=["POST"]),
        ]

    async def clips(self, request: Request) -> Response:
        """All clips, newest first, with what is labelled of each."""
        found = await anyio.to_thread.run_sync(
            lambda: [self._shown(about) for about in self._library.clips()]
        )
        recordings = {camera: _told(one) for camera, one in self._library.recordings.items()}
        return JSONResponse({"clips": found, "recordings": recordings, "room": self._library.room})

    async def upload(self, request: Request) -> Response:
        """Take in a video: the body is the file; `name` and `camera` stand in the query."""
        require(request, UserRole.ENGINEER)
        name = _shown_name(request.query_params.get("name", ""))
        camera = self._context.config.camera(request.query_params.get("camera", "")).id
        declared, room = whole_number(request.headers.get("content-length", ""), 1 << 62), self._library.room
        if declared is not None and declared > room:
            return problem(413, f"there is room for {max(0, room) >> 20} MiB (console.work_mb)")
        user = request.scope["user"].name
        with self._library.arriving(name) as path:
            written = 0
            async with await anyio.open_file(path, "wb") as file:
                async for piece in request.stream():
                    written += len(piece)
                    if written > room:
                        return problem(413, f"there is room for {max(0, room) >> 20} MiB (console.work_mb)")
                    await file.write(piece)
            about = await anyio.to_thread.run_sync(self._library.take, path, name, camera, "file", user)
        return JSONResponse(self._shown(about), 201)

    async def recording(self, request: Request) -> Response:
        """How far the latest recording of a camera is."""
        camera = self._context.config.camera(request.path_params["camera"]).id
        found = self._library.recordings.get(camera)
        return JSONResponse({"recording": _told(found) if found else None})

    async def record(self, request: Request) -> Response:
        """Record the camera for so many `seconds`."""
        require(request, UserRole.ENGINEER)
        camera = self._context.config.camera(request.path_params["camera"]).id
        seconds = (await body_of(request)).get("seconds")
        if not isinstance(seconds, int | float) or not 1 <= seconds <= _MOST_SECONDS:
            raise BadRequestError(f"seconds: must be a number from 1 to {_MOST_SECONDS}")
        context = self._context
        key = Keys(context.config.site).jpeg(camera)
        begun = self._library.record(context.bus, key, camera, float(seconds), request.scope["user"].name)
        return JSONResponse({"recording": _told(begun)}, 202)

    async def stop(self, request: Request) -> Response:
        """End a recording; what it has is kept."""
        require(request, UserRole.ENGINEER)
        camera = self._context.config.camera(request.path_params["camera"]).id
        if camera in self._library.recordings:
            self._library.recordings[camera].stop.set()
        return await self.recording(request)

    async def clip(self, request: Request) -> Response:
        """A clip with its labels."""
        about = self._library.about(request.path_params["clip"])
        kept = await anyio.to_thread.run_sync(self._library.labels, about.id)
        return JSONResponse({**self._shown(about), **_kept(kept)})

    async def remove(self, request: Request) -> Response:
        """Remove a clip with its labels."""
        require(request, UserRole.ENGINEER)
        await anyio.to_thread.run_sync(self._library.remove, request.path_params["clip"])
        return JSONResponse({})

    async def frame(self, request: Request) -> Response:
        """One frame, from 1."""
        jpeg = await anyio.to_thread.run_sync(
            self._library.jpeg, request.path_params["clip"], request.path_params["number"]
        )
        headers = {"Cache-Control": "private, max-age=86400, immutable"}
        return Response(jpeg, media_type="image/jpeg", headers=headers)

    async def label(self, request: Request) -> Response:
        """Put `labels` in the place of those of a `revision`."""
        require(request, UserRole.ENGINEER)
        given = await body_of(request, _MOST_LABELS)
        revision = given.get("revision")
        if type(revision) is not int:
            raise BadRequestError("revision: is not a whole number")
        try:
            labels = Labels.model_validate(given.get("labels"))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise BadRequestError(f"labels.{where}: {first['msg']}".replace(".: ", ": ")) from error
        return await self._put(request, labels, revision)

    async def export(self, request: Request) -> Response:
        """The labels as MOTChallenge text."""
        about = self._library.about(request.path_params["clip"])
        kept = await anyio.to_thread.run_sync(self._library.labels, about.id)
        name = Path(about.file).with_suffix(".txt").name
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(to_mot(kept.labels), media_type="text/plain; charset=utf-8", headers=headers)

    async def take(self, request: Request) -> Response:
        """Take in a MOTChallenge file, in the place of the labels of a `revision`."""
        require(request, UserRole.ENGINEER)
        revision = whole(request, "revision", 0)
        content = bytearray()
        async for piece in request.stream():
            content += piece
            if len(content) > _MOST_LABELS:
                return problem(413, f"the labels are larger than {_MOST_LABELS >> 20} MiB")
        tracks = await anyio.to_thread.run_sync(_tracks, bytes(content))
        return await self._put(request, tracks, revision)

    async def _put(self, request: Request, labels: Labels, revision: int) -> Response:
        user = request.scope["user"].name
        try:
            kept = await anyio.to_thread.run_sync(
                self._library.label, request.path_params["clip"], labels, revision, user
            )
        except LabelConflictError as error:
            return problem(409, str(error))
        return JSONResponse(_kept(kept))

    def _shown(self, about: About) -> dict[str, Any]:
        labels = self._library.labels(about.id).labels
        told: dict[str, Any] = about.model_dump(mode="json", exclude={"file"})
        counted = {"lumps": len(labels.tracks), "proposed": len(labels.proposals), "empty": labels.empty}
        return {**told, **counted}


def _kept(kept: Kept) -> dict[str, Any]:
    return kept.model_dump(mode="json", include={"revision", "labels"})


def _told(recording: Recording) -> dict[str, Any]:
    return {
        "camera": recording.camera, "by": recording.by, "seconds": recording.seconds, "runs": recording.runs,
        "at_s": round(recording.at_s, 1), "pictures": recording.pictures, "missed": recording.missed,
        "error": recording.error, "clip": recording.clip,
    }  # fmt: skip


def _tracks(content: bytes) -> Labels:
    """The labels of a file. Raises LabelError, ClipError."""
    with tempfile.NamedTemporaryFile(suffix=".txt") as file:
        file.write(content)
        file.flush()
        try:
            boxes = read_labels(Path(file.name))
        except Exception as error:
            raise ClipError(str(error).replace(file.name, "the label file")) from error
    try:
        return Labels(tracks=from_boxes(boxes))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        raise ClipError(f"the label file: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def _shown_name(name: str) -> str:
    """A file's name for people: one line, without a folder. Raises ClipError."""
    plain = (
        "".join(letter for letter in name if letter.isprintable())
        .replace("\\", "/")
        .rpartition("/")[2]
        .strip()
    )
    if not plain:
        raise ClipError("name: the file needs a name")
    return plain[-100:]
