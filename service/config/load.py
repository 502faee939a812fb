"""From a YAML file to a checked configuration, or to one line that names file, key and expectation."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from service.config.site import SiteConfig
from service.errors import ConfigError

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")
_MAX_BYTES = 4 << 20


def load(path: Path, environ: Mapping[str, str] = os.environ) -> SiteConfig:
    """Read and check the configuration file.

    Raises ConfigError, one line, for a file that cannot be read, YAML that cannot be parsed, an
    unset variable, or a key that is unknown, missing or wrong.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a configuration")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text") from error
    config = parse(text, str(path), environ)
    if not config.store.path.is_absolute():
        store = config.store.model_copy(update={"path": path.parent / config.store.path})
        config = config.model_copy(update={"store": store})
    return config


def parse(text: str, name: str = "config", environ: Mapping[str, str] = os.environ) -> SiteConfig:
    """Check the configuration in `text`; `name` stands for the file in error messages."""
    try:
        tree = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        raise ConfigError(f"{name}: {_yaml_problem(error)}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{name}: is not valid YAML ({type(error).__name__})") from error
    if not isinstance(tree, dict):
        raise ConfigError(f"{name}: expected a mapping with the keys site and cameras")
    tree = _substitute(tree, name, "", environ)
    try:
        return SiteConfig.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(f"{name}: {_first_problem(error)}") from error


def schema() -> str:
    """The JSON Schema of the configuration file."""
    return json.dumps(SiteConfig.model_json_schema(), indent=2, sort_keys=True)


def _yaml_problem(error: YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or "is not valid YAML"
    where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
    return " ".join(f"{where}{problem}".split())


def _substitute(node: Any, name: str, where: str, environ: Mapping[str, str]) -> Any:
    """Replace `${VAR}` by the environment, or by the content of the file that `VAR_FILE` names."""
    if isinstance(node, dict):
        return {
            k: _substitute(v, name, f"{where}.{k}" if where else str(k), environ) for k, v in node.items()
        }
    if isinstance(node, list):
        return [_substitute(v, name, f"{where}[{i}]", environ) for i, v in enumerate(node)]
    if not isinstance(node, str):
        return node

    def value(match: re.Match[str]) -> str:
        key = match.group(1)
        if key in environ:
            return environ[key]
        if (file := environ.get(f"{key}_FILE")) is not None:
            try:
                return Path(file).read_text(encoding="utf-8").rstrip("\r\n")
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigError(
                    f"{name}: {where}: the file that {key}_FILE names cannot be read"
                ) from error
        raise ConfigError(f"{name}: {where}: environment variable {key} is not set (nor {key}_FILE)")

    return _VARIABLE.sub(value, node)


def _first_problem(error: ValidationError) -> str:
    """One line: key, what was expected, what was found (never a secret), and how many more there are."""
    found_all = error.errors(include_url=False, include_context=False)
    # A list whose entry is wrong is reported as too short as well: only the innermost problems speak.
    problems = [
        p
        for p in found_all
        if not any(p["loc"] == q["loc"][: len(p["loc"])] and p["loc"] != q["loc"] for q in found_all)
    ]
    first = problems[0]
    where = ""
    for part in first["loc"]:
        where += f"[{part}]" if isinstance(part, int) else f".{part}" if where else str(part)
    kind, message = first["type"], str(first["msg"])
    if kind == "extra_forbidden":
        message = "unknown key"
    elif kind == "missing":
        message = "missing"
    elif kind == "value_error":
        message = message.removeprefix("Value error, ")
    else:
        found = first.get("input")
        message = message[:1].lower() + message[1:]
        if isinstance(found, str | int | float) and "url" not in where:
            message += f", found {found!r}"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{where or 'configuration'}: {' '.join(message.split())}{more}"
