"""Writes docs/reference from the code: `make docs`. A test fails where a page is out of date."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry
from pydantic import BaseModel

from lumpwatch.service.cli import parser
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.protocol.asyncapi import asyncapi_text
from lumpwatch.service.protocol.messages import StateLine
from lumpwatch.service.protocol.schemas import MESSAGES
from lumpwatch.service.telemetry import OLDER, CameraMetrics, DaemonMetrics, HubMetrics, MonitorMetrics
from lumpwatch.service.telemetry.proof import ProofMetrics

HERE = Path(__file__).parent / "reference"
NOTE = "<!-- Written by `make docs` from the code; edit the code instead. -->\n"


def config_page() -> str:
    """Every key of the configuration file."""
    schema = SiteConfig.model_json_schema()
    parts = [f"{NOTE}\n# Configuration\n"]
    parts.append(
        "YAML; unknown keys are refused. `${VAR}` is replaced by the environment variable `VAR`, or by the "
        "content of the file that `VAR_FILE` names. Coordinates are relative to the picture, 0 to 1; "
        "`_s` is seconds, `_h` ROI heights, `_px` pixels.\n"
    )
    parts.append(_model("(top level)", schema))
    parts += [_model(name, model) for name, model in schema["$defs"].items()]
    return "\n".join(parts)


def messages_page() -> str:
    """Every field of the messages on the bus and of the replay's lines."""
    parts = [f"{NOTE}\n# Messages\n", "JSON. `lumpwatch schema alarm` and the like print the JSON Schemas.\n"]
    for model in MESSAGES.values():
        schema = model.model_json_schema(mode="serialization")
        parts.append(_model(model.__name__, schema, _summary(model)))
        parts += [
            _model(name, inner)
            for name, inner in schema.get("$defs", {}).items()
            if model is not StateLine and ("properties" in inner or name == "BlindReason")
        ]
    return "\n".join(dict.fromkeys(parts))


def metrics_page() -> str:
    """Every metric."""
    registry = CollectorRegistry()
    DaemonMetrics(registry, "0", Path())
    HubMetrics(registry)
    CameraMetrics(registry, "c")
    shared = CollectorRegistry()
    MonitorMetrics(shared, "c", ("r",))
    ProofMetrics(shared, "c", ("r",))
    rows = ["| metric | type | meaning |", "|---|---|---|"]
    families = {family.name: family for source in (registry, shared) for family in source.collect()}
    for _, family in sorted(families.items()):
        name = family.name + ("_total" if family.type == "counter" else "")
        rows.append(f"| `{name}` | {family.type} | {family.documentation} |")
    older = ["| before | now |", "|---|---|"]
    for name, before in sorted(OLDER.items()):
        end = "_total" if families[name].type == "counter" else ""
        label = f"; label `{before.was}` is `{before.label}`" if before.label else ""
        note = "; now a time, before an age" if before.age else label
        older.append(f"| `{before.name}{end}` | `{name}{end}`{note} |")
    return (
        f"{NOTE}\n# Metrics\n\nAll carry the label `camera` but those of the daemon itself; those of a ROI also `roi`. "
        "Base units: metres, seconds, bytes, ratios; pixels where nothing says how large one is.\n\n"
        + "\n".join(rows)
        + "\n\n## Names of 0.1\n\nExported beside the new ones for one more release; rewrite rules and panels that use "
        "them.\n\n" + "\n".join(older) + "\n"
    )


def commands_page() -> str:
    """The help of every command."""
    parts = [f"{NOTE}\n# Commands\n", "Exit codes: 0 good, 1 failed, 2 bad arguments or configuration.\n"]
    top = parser()
    chosen = next(a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in chosen.choices.items():
        command.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(prog, width=96)
        parts.append(f"## lumpwatch {name}\n\n```\n{command.format_help().strip()}\n```\n")
    return "\n".join(parts)


def pages() -> dict[Path, str]:
    """All generated pages."""
    return {
        HERE / "configuration.md": config_page(),
        HERE / "messages.md": messages_page(),
        HERE / "metrics.md": metrics_page(),
        HERE / "commands.md": commands_page(),
        HERE / "asyncapi.yaml": f"# {NOTE[5:-5]}\n{asyncapi_text()}",
    }


def _summary(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip()


def _model(name: str, schema: dict[str, Any], text: str | None = None) -> str:
    rows = [f"## {name}\n", (text or schema.get("description", "")).strip() + "\n"]
    rows += ["| key | type | default | meaning |", "|---|---|---|---|"]
    required = set(schema.get("required", ()))
    for key, field in schema.get("properties", {}).items():
        default = "required" if key in required else _default(field.get("default"))
        meaning = " ".join(field.get("description", "").split()).replace("|", "\\|")
        rows.append(f"| `{key}` | {_type(field)} | {default} | {meaning} |")
    if "enum" in schema:
        return (
            f"## {name}\n\n{schema.get('description', '')}\n\n{', '.join(f'`{v}`' for v in schema['enum'])}\n"
        )
    return "\n".join(rows) + "\n"


def _default(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, dict | list):
        text = json.dumps(value)
        return "see below" if len(text) > 60 else f"`{text}`"
    return f"`{json.dumps(value)}`"


def _type(field: dict[str, Any]) -> str:
    if "$ref" in field:
        return f"[{field['$ref'].rpartition('/')[2]}](#{field['$ref'].rpartition('/')[2].lower()})"
    if "anyOf" in field or "oneOf" in field:
        return " or ".join(dict.fromkeys(_type(option) for option in field.get("anyOf") or field["oneOf"]))
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    if "const" in field:
        return f"`{field['const']}`"
    kind = field.get("type", "any")
    if kind == "array":
        inner = field.get("items") or (field.get("prefixItems") or [{}])[0]
        return f"list of {_type(inner)}"
    limits = [f"{sign} {field[key]:g}" for key, sign in _LIMITS if key in field]
    return f"{kind} {', '.join(limits)}".strip()


_LIMITS = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))

if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
