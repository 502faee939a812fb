"""From a YAML file to a checked configuration, or to one line that names file, key and expectation."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, Event

from lumpwatch.service.config.base import Id
from lumpwatch.service.config.known_keys import keys_at
from lumpwatch.service.config.site import SiteConfig
from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import ConfigError

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")
_MAX_BYTES = 1 << 20  # the reader takes some 30 s for that in the worst case
_MOST_SECRET = 64 << 10
_MOST_LEVELS = 50  # a configuration has some ten


def load_config(path: Path, environ: Mapping[str, str] = os.environ, *, secrets: bool = True) -> SiteConfig:
    """Read and check the configuration file.

    Work on files opens no camera: without `secrets` variables that are not set may stay so where only a camera, the bus
    or the console would need them.

    Raises ConfigError, one line, for a file that cannot be read, YAML that cannot be parsed, an
    unset variable, or a key that is unknown, missing or wrong.
    """
    text = read_text(path)
    config = parse_config(text, str(path), environ, path.parent, secrets=secrets)
    store = config.store.model_copy(update={"path": path.parent / config.store.path})
    tls = config.bus.tls.under(path.parent) if config.bus.tls is not None else None
    bus = config.bus.model_copy(update={"tls": tls})
    cameras = tuple(
        camera.model_copy(update={"source": camera.source.under(path.parent)}) for camera in config.cameras
    )
    return config.model_copy(
        update={
            "store": store,
            "bus": bus,
            "console": config.console.under(path.parent),
            "gateway": config.gateway.under(path.parent),
            "cameras": cameras,
        }
    )


def read_text(path: Path) -> str:
    """The configuration file's text. Raises ConfigError where it cannot be one."""
    try:
        return read_bounded(path, _MAX_BYTES).decode("utf-8")
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise ConfigError(f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a configuration") from error
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text") from error


def site_name(path: Path) -> str:
    """The name of the site alone: also from a file whose other keys are wrong or whose secrets are not here.

    Raises ConfigError.
    """
    try:
        return TypeAdapter(Id).validate_python(_read_yaml(read_text(path)).get("site"))
    except ValidationError:
        raise ConfigError(f"{path}: site: expected a name") from None
    except ConfigError as error:
        named = str(error).startswith(str(path))
        raise ConfigError(str(error) if named else f"{path}: {error}") from None


def parse_config(
    text: str,
    name: str = "config",
    environ: Mapping[str, str] = os.environ,
    folder: Path | None = None,
    *,
    secrets: bool = True,
) -> SiteConfig:
    """Check the configuration in `text`; `name` stands for the file in error messages.

    Relative paths of networks count from `folder`; `secrets` as in `load_config`.
    """
    given: list[str] = []
    try:
        tree = _substitute(_read_yaml(text), "", environ, given, secrets)
        return SiteConfig.model_validate(tree, context={"folder": folder})
    except ValidationError as error:
        problem = _first_problem(error)
    except ConfigError as error:
        problem = str(error)
    except UnicodeError:
        problem = "holds characters that are no text (lone surrogates)"
    problem = _masked(problem, given)
    problem = problem.encode("utf-8", "backslashreplace").decode()
    # Not chained: the causes carry the configuration, and with it what is secret in it.
    raise ConfigError(f"{name}: {' '.join(problem.split())}") from None


def variables(text: str, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The variables that a configuration's text names and the environment gives, with their values: secrets."""
    names = sorted({match.group(1) for match in _VARIABLE.finditer(text)})
    return {name: _variable(name, name, environ) for name in names if {name, f"{name}_FILE"} & environ.keys()}


def config_schema() -> str:
    """The JSON Schema of the configuration file."""
    return json.dumps(SiteConfig.model_json_schema(), indent=2, sort_keys=True)


def _read_yaml(text: str) -> dict[Any, Any]:
    """The tree in the text; aliases are refused, since a few of them can stand for gigabytes."""
    try:
        events = YAML(typ="safe", pure=True).parse(text)
        alias = _first_alias(events)
        tree = YAML(typ="safe", pure=True).load(text) if alias is None else None
    except ConfigError:
        raise
    except DuplicateKeyError as error:
        # The parser's own words hold the values as well, which may be secret.
        key = re.match(r'found duplicate key "([^"]*)"', str(error.problem))
        named = f'duplicate key "{key.group(1)[:60]}"' if key else "a key is given twice"
        raise ConfigError(f"{_place(error)}{named}") from None
    except YAMLError as error:
        raise ConfigError(
            f"{_place(error)}{getattr(error, 'problem', None) or 'is not valid YAML'}"
        ) from None
    except Exception as error:
        raise ConfigError(f"is not valid YAML ({type(error).__name__})") from None
    if alias is not None:
        raise ConfigError(f"line {alias.start_mark.line + 1}: YAML aliases are not supported")
    if not isinstance(tree, dict):
        raise ConfigError("expected a mapping with the keys site and cameras")
    return tree


def _first_alias(events: Iterable[Event]) -> AliasEvent | None:
    """Of the whole text; raises ConfigError at what is nested too deeply: reading takes the square of the depth."""
    depth = 0
    for event in events:
        if isinstance(event, AliasEvent):
            return event
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > _MOST_LEVELS:
            mark = event.start_mark
            raise ConfigError(
                f"line {mark.line + 1}, column {mark.column + 1}: more than {_MOST_LEVELS} levels"
            )
    return None


def _place(error: YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""


def _masked(problem: str, secrets: Iterable[str]) -> str:
    """The problem without secrets. Short ones are looked for in quotes alone, or every word would be torn apart."""
    for secret in sorted(secrets, key=len, reverse=True):
        if len(secret) >= _LEAST_SECRET:
            problem = problem.replace(secret, "***")
        else:
            quoted = {found for found in re.findall(r"'[^']*'", problem) if secret in found}
            for found in quoted:
                problem = problem.replace(found, "'***'")
    return problem


_LEAST_SECRET = 4
_UNSET = "unset"
_SECRET = re.compile(r"(cameras\[\d+\]\.source|bus|console|telemetry)\b")
"""Where a variable may be missing when no secret is needed."""


def _substitute(node: Any, where: str, environ: Mapping[str, str], secrets: list[str], needed: bool) -> Any:
    """Replace `${VAR}` by the environment, or by the content of the file that `VAR_FILE` names."""
    if isinstance(node, dict):
        return {
            key: _substitute(value, f"{where}.{key}" if where else str(key), environ, secrets, needed)
            for key, value in node.items()
        }
    if isinstance(node, list):
        return [_substitute(value, f"{where}[{i}]", environ, secrets, needed) for i, value in enumerate(node)]
    if not isinstance(node, str):
        return node

    def value(match: re.Match[str]) -> str:
        name = match.group(1)
        if not needed and _SECRET.match(where) and not {name, f"{name}_FILE"} & environ.keys():
            return _UNSET
        found = _variable(name, where, environ)
        if found:
            secrets.append(found)
        return found

    text = _VARIABLE.sub(value, node)
    if "\0" in text:
        raise ConfigError(f"{where}: holds a zero byte, which nothing can be called by")
    return text


def _variable(key: str, where: str, environ: Mapping[str, str]) -> str:
    if key in environ:
        return environ[key]
    if (file := environ.get(f"{key}_FILE")) is not None:
        try:
            return read_bounded(Path(file), _MOST_SECRET).decode("utf-8").rstrip("\r\n")
        except (OSError, UnicodeDecodeError):
            raise ConfigError(f"{where}: the file that {key}_FILE names cannot be read") from None
    raise ConfigError(f"{where}: environment variable {key} is not set (nor {key}_FILE)")


_KINDS = frozenset({"jdt", "imm_pf", "jpda", "lump", "histogram", "mixture", "statistical", "network"})
"""Kinds that pydantic puts into the place of a problem, though no key of the file is called so."""


def _first_problem(error: ValidationError) -> str:
    """One line: key, what was expected, what was found (never a secret), and how many more there are."""
    found_all = error.errors(include_url=False, include_context=False)
    # A list whose entry is wrong is reported as too short as well: only the innermost problems speak.
    holders = {one["loc"][:depth] for one in found_all for depth in range(len(one["loc"]))}
    problems = [one for one in found_all if one["loc"] not in holders]
    # A key that is written wrongly is also missing: what is there is named first.
    problems.sort(key=lambda one: one["type"] != "extra_forbidden")
    first = problems[0]
    where = ""
    for part in first["loc"]:
        if part in _KINDS:
            continue
        where += f"[{part}]" if isinstance(part, int) else f".{part}" if where else str(part)
    kind, message = first["type"], str(first["msg"])
    if kind == "extra_forbidden":
        message = "unknown key"
        if near := get_close_matches(str(first["loc"][-1]), keys_at(first["loc"][:-1]), n=1):
            message += f"; did you mean {near[0]}?"
    elif kind == "missing":
        message = "missing"
    elif kind == "value_error":
        message = message.removeprefix("Value error, ")
    else:
        message = message[:1].lower() + message[1:] + _found(first.get("input"))
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{where or 'configuration'}: {message}{more}"


def _found(value: Any) -> str:
    """What was there instead, where it is short and cannot be an address with a password."""
    if isinstance(value, bool | float) or (isinstance(value, int) and abs(value) < 10**18):
        return f", found {value!r}"
    if isinstance(value, str) and len(value) <= 40 and not set(value) & set("@/?"):
        return f", found {value!r}"
    return ""
