"""The OpenAPI document of the API, made from its routes: what is served is what is described."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

from starlette.routing import BaseRoute, Route

from lumpwatch.service.console.guard import TOKEN_HEADER
from lumpwatch.service.console.work import body_schemas
from lumpwatch.service.protocol import COMMANDS

_PART = re.compile(r"\{(\w+)\}")
_CONVERTER = re.compile(r":\w+\}")
_TYPES = {
    "picture": "image/jpeg",
    "{number}.jpg": "image/jpeg",
    "stream": "text/event-stream",
    "events.csv": "text/csv",
    "labels.txt": "text/plain",
    "report": "text/html",
}
_REF = "#/components/schemas/{model}"
_BODIES = {"jobs": "Order", "priors": "PriorDeed"}
_RAW = {"clips": "application/octet-stream", "labels.txt": "text/plain"}
"""Bodies that are files, by the last part of the path."""


def openapi(routes: Iterable[BaseRoute]) -> dict[str, Any]:
    """OpenAPI 3.1 of the routes under `/api/v1`."""
    paths: dict[str, Any] = {}
    for route in routes:
        if not isinstance(route, Route) or not route.path.startswith("/api/v1/"):
            continue
        for method in sorted((route.methods or set()) - {"HEAD"}):
            path = _CONVERTER.sub("}", route.path)
            paths.setdefault(path, {})[method.lower()] = _operation(route, path, method)
    return {
        "openapi": "3.1.0",
        "info": {"title": "lumpwatch console", "version": version("lumpwatch")},
        "paths": dict(sorted(paths.items())),
        "components": {
            "schemas": {
                "Problem": {
                    "type": "object",
                    "required": ["error"],
                    "properties": {"error": {"type": "string"}},
                },
                **body_schemas(_REF),
                **{
                    name: row.request.model_json_schema()
                    for name, row in COMMANDS.items()
                    if row.action or name == "verdict"
                },
            },
            "securitySchemes": {"session": {"type": "apiKey", "in": "cookie", "name": "lumpwatch"}},
        },
        "security": [{"session": []}],
    }


def _operation(route: Route, path: str, method: str) -> dict[str, Any]:
    last = path.rpartition("/")[2]
    parameters: list[dict[str, Any]] = [
        {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}
        for name in _PART.findall(path)
    ]
    if method != "GET":
        token = {"name": TOKEN_HEADER, "in": "header", "required": True, "schema": {"type": "string"}}
        parameters.append(token | {"description": "What /api/v1/me tells as csrf."})
    content: dict[str, Any] = {_TYPES.get(last, "application/json"): {}}
    problem = {
        "description": "What is wrong, in one line.",
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
    told: dict[str, Any] = {
        "summary": (route.endpoint.__doc__ or "").strip(),
        "parameters": parameters,
        "responses": {"200": {"description": "The answer.", "content": content}, "default": problem},
    }
    if method == "POST" and last in _RAW:
        told["requestBody"] = {"content": {_RAW[last]: {}}}
    elif method == "POST":
        named = {"$ref": _REF.format(model=_BODIES[last])} if last in _BODIES else {"type": "object"}
        told["requestBody"] = {"content": {"application/json": {"schema": named}}}
    return told
