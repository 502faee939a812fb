"""`lumpwatch deploy`: the daemon as a container, on any engine with a Docker-compatible socket."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import site_name
from lumpwatch.service.deployment import Bundle, DeployError, Found, Plan, Rollout, bundle, short_name

if TYPE_CHECKING:
    from lumpwatch.service.deployment import DockerEngine

_WIDE = 240


def plan(arguments: argparse.Namespace) -> int:
    """Run `deploy plan`."""
    wanted, engine = _bundle(arguments), _engine(arguments)
    rollout = Rollout(engine, wanted.name, 0.0, _say)
    image = engine.image(arguments.image)
    decided = rollout.plan(image, wanted)
    if arguments.json:
        tell_json(_decided(decided, wanted, image))
        return 0
    _say(f"{wanted.name}: {decided.action} ({'; '.join(decided.reasons)})")
    _say(
        f"image {arguments.image} {short_name(image)}, network {wanted.network}, store {wanted.store_volume}"
    )
    _say(f"shared memory {wanted.shm_mib} MiB, memory limit {wanted.memory_mib} MiB")
    return 0


def up(arguments: argparse.Namespace) -> int:
    """Run `deploy up`."""
    given = [argument.partition("=") for argument in arguments.build_arg]
    if wrong := [key for key, equals, _ in given if not key or not equals]:
        raise DeployError(f"--build-arg {wrong[0]}: expected KEY=VALUE")
    wanted, engine, say = _bundle(arguments), _engine(arguments), _sayer(arguments)
    if arguments.build is not None:
        say(f"building {arguments.image} from {arguments.build}")
        image = engine.build(arguments.build, arguments.image, {key: value for key, _, value in given})
    else:
        image = engine.image(arguments.image, arguments.pull)
    done = Rollout(engine, wanted.name, arguments.timeout, say).up(image, wanted)
    if arguments.json:
        tell_json({**_decided(done, wanted, image), "ready": True})
    return 0


def rollback(arguments: argparse.Namespace) -> int:
    """Run `deploy rollback`."""
    engine = _engine(arguments)
    rollout = _rollout(arguments, engine, arguments.timeout)
    rollout.rollback()
    if arguments.json:
        kept = (engine.found(name) for name in (rollout.current, rollout.previous))
        tell_json({"containers": [_facts(found) for found in kept if found is not None], "ready": True})
    return 0


def status(arguments: argparse.Namespace) -> int:
    """Run `deploy status`."""
    engine = _engine(arguments)
    rollout = _rollout(arguments, engine)
    rows = [engine.found(name) for name in (rollout.current, rollout.previous)]
    current = rows[0]
    problems = engine.health(rollout.current) if current is not None and current.running else None
    if current is not None and arguments.json:
        why = ["it does not answer"] if problems is None else problems
        kept = [_facts(row) for row in rows if row is not None]
        tell_json({"containers": kept, "ready": not why, "problems": why})
        return 1 if why else 0
    table = Table()
    for heading in ("container", "state", "image", "configuration", "started"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        if row is not None:
            table.add_row(*_cells(row))
    if current is None:
        raise DeployError(f"{rollout.current}: no such container; start it by lumpwatch deploy up")
    # A pipe has no width: there nothing is cut off or broken.
    Console(markup=False, width=None if sys.stdout.isatty() else _WIDE).print(table)
    for problem in ["it does not answer"] if problems is None else problems:
        _say(f"not ready: {problem}")
    if problems == []:
        _say("ready")
    return 0 if problems == [] else 1


def logs(arguments: argparse.Namespace) -> int:
    """Run `deploy logs`."""
    engine = _engine(arguments)
    name = _rollout(arguments, engine).current
    if arguments.follow:
        for part in engine.follow(name, arguments.tail):
            sys.stdout.write(part.decode(errors="replace"))
            sys.stdout.flush()
        return 0
    for line in engine.logs(name, arguments.tail):
        _say(line)
    return 0


def _cells(found: Found) -> tuple[str, ...]:
    restarts = f", {found.restarts} restarts" if found.restarts else ""
    return found.name, found.status + restarts, short_name(found.image), found.digest[:12], found.since[:19]


def _facts(found: Found) -> dict[str, object]:
    return {
        "name": found.name,
        "state": found.status,
        "restarts": found.restarts,
        "image": found.image,
        "configuration": found.digest,
        "started": found.since,
    }


def _decided(plan: Plan, wanted: Bundle, image: str) -> dict[str, object]:
    return {
        "name": wanted.name,
        "action": plan.action.value,
        "reasons": list(plan.reasons),
        "image": image,
        "network": wanted.network,
        "store": wanted.store_volume,
        "shared_memory_mib": wanted.shm_mib,
        "memory_limit_mib": wanted.memory_mib,
    }


def _bundle(arguments: argparse.Namespace) -> Bundle:
    return bundle(arguments.config, arguments.network, arguments.memory)


def _rollout(arguments: argparse.Namespace, engine: DockerEngine, timeout_s: float = 0.0) -> Rollout:
    return Rollout(engine, f"lumpwatch-{site_name(arguments.config)}", timeout_s, _sayer(arguments))


def _engine(arguments: argparse.Namespace) -> DockerEngine:
    from lumpwatch.service.deployment import connect  # the SDK takes a while, and no other command needs it

    return connect(arguments.socket)


def _sayer(arguments: argparse.Namespace) -> Callable[[str], None]:
    """Where progress is told: beside the facts with `--json`."""
    return _aside if getattr(arguments, "json", False) else _say


def _aside(line: str) -> None:
    sys.stderr.write(line + "\n")


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
