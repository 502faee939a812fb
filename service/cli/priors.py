"""`lumpwatch priors`: list, show, try in shadow, promote, roll back, export and import the stored priors."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from rich.console import Console
from rich.table import Table

from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.protocol import summary
from lumpwatch.service.storage import (
    PriorError,
    PriorStore,
    check_owner,
    encode_prior,
    read_file,
    read_state,
    replace_file,
)


def priors(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    store = PriorStore(config.store.path, config.store.keep_priors)
    if arguments.action == "list":
        return _list(store, camera.id, roi.id, as_json=arguments.json)
    if arguments.action in _TRIAL:
        lines = _TRIAL[arguments.action](store, camera.id, roi.id, arguments.version)
        return _tell(arguments, store, camera.id, roi.id, lines)
    if arguments.file is None:
        raise ConfigError(f"priors {arguments.action} needs a FILE")
    if arguments.action == "import":
        prior = read_file(arguments.file)
        check_owner(prior, camera.id, roi.id, str(arguments.file))
        stored = store.save(prior, shadow=arguments.shadow)
        what = "runs in shadow" if arguments.shadow else "in use"
        line = f"{camera.id}/{roi.id}: stored as version {stored.version} and {what}"
    else:
        line = _write(store, camera.id, roi.id, arguments)
    return _tell(arguments, store, camera.id, roi.id, [line])


def _tell(
    arguments: argparse.Namespace, store: PriorStore, camera: str, roi: str, lines: Sequence[str]
) -> int:
    if not arguments.json:
        print("\n".join(lines))  # noqa: T201
        return 0
    in_use = store.current(camera, roi).prior
    tell_json(
        {
            "action": arguments.action,
            "camera": camera,
            "roi": roi,
            "in_use": None if in_use is None else in_use.version,
            "in_shadow": store.shadow_pointer(camera, roi),
            "said": list(lines),
        }
    )
    return 0


def _rollback(store: PriorStore, camera: str, roi: str, version: int | None) -> Sequence[str]:
    if version is None:
        raise ConfigError("priors rollback needs --version N")
    if version == 0:
        store.use_defaults(camera, roi)
        return [f"{camera}/{roi}: the stated defaults are in use"]
    store.use(camera, roi, version)
    return [f"{camera}/{roi}: version {version} is in use"]


def _promote(store: PriorStore, camera: str, roi: str, version: int | None) -> Sequence[str]:
    before = store.current(camera, roi).prior
    prior = store.promote(camera, roi, version)
    return [
        f"{camera}/{roi}: version {prior.version} is in use; back with "
        f"priors rollback --version {before.version if before else 0}"
    ]


def _drop(store: PriorStore, camera: str, roi: str, version: int | None) -> Sequence[str]:
    dropped = store.drop_shadow(camera, roi, version)
    return [f"{camera}/{roi}: version {dropped} no longer runs in shadow"]


def _shadow(store: PriorStore, camera: str, roi: str, version: int | None) -> Sequence[str]:
    if version is not None:
        store.set_shadow(camera, roi, version)
        return [f"{camera}/{roi}: version {version} runs in shadow"]
    wanted = store.shadow_pointer(camera, roi)
    if wanted is None:
        return [f"{camera}/{roi}: no prior runs in shadow"]
    state = read_state(store, camera, roi)
    if state is None or state.version != wanted:
        return [f"{camera}/{roi}: version {wanted} is to run in shadow; nothing was counted yet"]
    return list(summary(state))


_TRIAL = {"shadow": _shadow, "promote": _promote, "drop": _drop, "rollback": _rollback}


def _write(store: PriorStore, camera: str, roi: str, arguments: argparse.Namespace) -> str:
    if arguments.version is not None:
        prior = store.load(camera, roi, arguments.version)
    else:
        found = store.current(camera, roi).prior
        if found is None:
            raise PriorError(f"{camera}/{roi}: has no prior that can be read")
        prior = found
    if arguments.action == "show":
        from lumpwatch.service.offline import draw_prior

        draw_prior(prior, arguments.file)
    else:
        try:
            replace_file(arguments.file, encode_prior(prior))
        except OSError as error:
            raise LumpwatchError(f"{arguments.file}: cannot be written ({error.strerror})") from error
    return f"{camera}/{roi}: version {prior.version} -> {arguments.file}"


def _list(store: PriorStore, camera: str, roi: str, *, as_json: bool) -> int:
    found = [_version(store, camera, roi, version) for version in store.versions(camera, roi)]
    if as_json:
        tell_json(found)
        return 0
    table = Table(title=f"{camera}/{roi}: priors in {store.folder(camera, roi)}")
    for heading in ("version", "created", "from", "objects", "models", "state"):
        table.add_column(heading)
    for one in found:
        if "refused" in one:
            table.add_row(str(one["version"]), "", "", "", "", f"refused: {one['refused']}")
            continue
        created = datetime.fromisoformat(one["created"])
        table.add_row(
            str(one["version"]),
            f"{created:%Y-%m-%d %H:%M:%S}",
            one["source"],
            str(one["objects"]),
            ", ".join(one["models"]),
            one["state"] or "",
        )
    Console(markup=False).print(table)
    return 0


def _version(store: PriorStore, camera: str, roi: str, version: int) -> dict[str, Any]:
    """What is known of one version, as plain data; `refused` says why it cannot be read."""
    try:
        prior = store.load(camera, roi, version)
    except PriorError as error:
        return {"version": version, "refused": str(error)}
    in_use = store.current(camera, roi).prior
    state = "never in use" if store.untried(camera, roi, version) else None
    if in_use is not None and in_use.version == version:
        state = "in use"
    elif version == store.shadow_pointer(camera, roi):
        state = "in shadow"
    return {
        "version": version,
        "created": prior.meta.created.isoformat(),
        "source": prior.meta.source,
        "objects": prior.learned.tracks,
        "models": list(prior.learned.models),
        "state": state,
    }
