"""Which keys may stand at a place of the configuration, to name the one that was meant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from lumpwatch.service.config.site import SiteConfig


def keys_at(place: Sequence[int | str]) -> list[str]:
    """The keys of the models that may stand there; `place` is a location as pydantic reports it."""
    schema = SiteConfig.model_json_schema()
    here = [schema]
    for part in place:
        below = [found for node in here for found in _below(node, part, schema)]
        here = below or here  # the name of a union's member is no place
    return sorted(
        {key for node in here for one in _models(node, schema) for key in one.get("properties", {})}
    )


def _below(node: dict[str, Any], part: int | str, schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for model in _models(node, schema):
        if isinstance(part, int):
            if isinstance(model.get("items"), dict):
                yield model["items"]
        elif part in model.get("properties", {}):
            yield model["properties"][part]


def _models(node: dict[str, Any], schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The node itself, with references followed and unions taken apart."""
    if (name := node.get("$ref")) is not None:
        yield from _models(schema["$defs"][name.rpartition("/")[2]], schema)
        return
    members = [*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())]
    if not members:
        yield node
    for member in members:
        yield from _models(member, schema)
