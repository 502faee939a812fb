"""Writes the objects of a whole site from one list of crushers.

    python -m deploy.kubernetes.make_site deploy/kubernetes/example/crushers.yaml
    kubectl apply -k deploy/kubernetes/example

Beside the list: a folder a crusher with its configuration and overlay, and `kustomization.yaml`. What is written is
written anew each time; a crusher that has left the list takes its folder along. Each configuration is checked as by
`lumpwatch check`.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.scalarstring import LiteralScalarString as Block

from lumpwatch.service.config import parse_config
from lumpwatch.service.errors import LumpwatchError

HERE = Path(__file__).parent
_NOTE = "# Written by deploy/kubernetes/make_site.py from {list}; edit that."
_NAME = r"[a-z0-9]([a-z0-9-]{0,40}[a-z0-9])?"
_CIDR = r"[0-9a-f.:]+/[0-9]+"
_SECRETS = "/run/secrets/bus"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Outside(_Strict):
    """A way for alarms to leave the cluster."""

    network: str = Field(pattern=_CIDR)
    """Whose clients are let in."""
    kind: Literal["LoadBalancer", "NodePort"] = "LoadBalancer"
    node_port: int | None = Field(default=None, ge=30000, le=32767)


class Crusher(_Strict):
    """One camera, one workload."""

    network: str = Field(pattern=_CIDR)
    """Where its camera is, for the network policy."""
    camera: dict[str, Any]
    """As in `site.yaml`; its id names the workload."""
    outside: Outside | None = None
    console: str | None = None
    """Name in the browser's address, where this workload has the page."""
    more: dict[str, Any] = Field(default_factory=dict)
    """Other sections of its `site.yaml`."""

    @property
    def name(self) -> str:
        """Of the workload."""
        return str(self.camera.get("id"))


class Site(_Strict):
    """The list."""

    namespace: str = Field(pattern=f"^{_NAME}$")
    image: str
    monitor: bool = True
    """Whether there is a Prometheus operator."""
    crushers: tuple[Crusher, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _apart(self) -> Self:
        names = [crusher.name for crusher in self.crushers]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"crushers: the camera {min(twice)} is there twice")
        return self


def read(path: Path) -> Site:
    """The list of a file. Raises ValueError naming file and key."""
    try:
        return Site.model_validate(YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{path}: {where}: {first['msg']}") from error


def files_of(site: Site, place: Path) -> dict[Path, str]:
    """Content by path beside the list, which lies at `place`. Raises ConfigError for a configuration that is wrong."""
    note = _NOTE.format(list=place.name)
    base = os.path.relpath(HERE, place.parent)
    written = {Path("kustomization.yaml"): _top(site, note, base)}
    for crusher in site.crushers:
        folder = Path(crusher.name)
        config = _text(_config(site, crusher), note)
        parse_config(config, f"{place}: {crusher.name}", secrets=False)
        written[folder / "site.yaml"] = config
        written[folder / "kustomization.yaml"] = _overlay(crusher, note, f"../{base}")
    return written


def write(path: Path) -> None:
    """Write what the list says, and take away what it no longer says."""
    made = files_of(read(path), path)
    for old in path.parent.glob("*/kustomization.yaml"):
        ours = _NOTE.format(list=path.name) in old.read_text(encoding="utf-8")
        if ours and old.relative_to(path.parent) not in made:
            shutil.rmtree(old.parent)
    for file, text in made.items():
        (path.parent / file).parent.mkdir(exist_ok=True)
        (path.parent / file).write_text(text, encoding="utf-8")


def _config(site: Site, crusher: Crusher) -> dict[str, Any]:
    console = {}
    if crusher.console is not None:
        console["console"] = {
            "listen": "0.0.0.0:8080",
            "users": "/var/lib/lumpwatch/users.json",
            "allow_http": True,
            "names": [crusher.console],
        }
    return {
        "site": site.namespace,
        "telemetry": {"listen": "0.0.0.0:9464"},
        "bus": {
            "listen": ["tls/0.0.0.0:7447"],
            "tls": {
                "ca": f"{_SECRETS}/ca.crt",
                "certificate": f"{_SECRETS}/tls.crt",
                "key": f"{_SECRETS}/tls.key",
            },
        },
        "store": {"path": "/var/lib/lumpwatch"},
        **console,
        **crusher.more,
        "cameras": [crusher.camera],
    }


def _overlay(crusher: Crusher, note: str, base: str) -> str:
    name = crusher.name
    secrets = "\n".join(
        f"- {{op: replace, path: /spec/template/spec/volumes/{place}/secret/secretName, value: {what}-{name}}}"
        for place, what in ((1, "camera"), (2, "bus"))
    )
    policy = [f"- {{op: replace, path: /spec/egress/1/to/0/ipBlock/cidr, value: {crusher.network}}}"]
    parts: list[str] = []
    patches: list[dict[str, Any]] = [{"target": {"kind": "StatefulSet"}, "patch": Block(secrets + "\n")}]
    if crusher.outside is not None:
        parts.append(f"{base}/outside")
        # Components are applied in this order, each adding its rule at the end.
        policy.append(
            f"- {{op: replace, path: /spec/ingress/2/from/0/ipBlock/cidr, value: {crusher.outside.network}}}"
        )
        service = [f"- {{op: replace, path: /spec/type, value: {crusher.outside.kind}}}"]
        if crusher.outside.node_port is not None:
            service.append(f"- {{op: add, path: /spec/ports/0/nodePort, value: {crusher.outside.node_port}}}")
        patches.append(
            {
                "target": {"kind": "Service", "name": "lumpwatch-outside"},
                "patch": Block("\n".join(service) + "\n"),
            }
        )
    if crusher.console is not None:
        parts.append(f"{base}/console")
    patches.append({"target": {"kind": "NetworkPolicy"}, "patch": Block("\n".join(policy) + "\n")})
    return _text(
        {
            "apiVersion": "kustomize.config.k8s.io/v1beta1",
            "kind": "Kustomization",
            "resources": [f"{base}/base"],
            **({"components": parts} if parts else {}),
            "nameSuffix": f"-{name}",
            "labels": [{"pairs": {"lumpwatch.io/camera": name}, "includeSelectors": True}],
            "configMapGenerator": [{"name": "lumpwatch", "behavior": "replace", "files": ["site.yaml"]}],
            "patches": patches,
        },
        note,
    )


def _top(site: Site, note: str, base: str) -> str:
    name, _, tag = site.image.rpartition(":")
    if not name or "/" in tag:
        raise ValueError(f"image: {site.image}: expected NAME:TAG")
    watched = [f"{base}/monitoring"] if site.monitor else []
    return _text(
        {
            "apiVersion": "kustomize.config.k8s.io/v1beta1",
            "kind": "Kustomization",
            "namespace": site.namespace,
            "resources": [*(crusher.name for crusher in site.crushers), f"{base}/priority", *watched],
            "images": [{"name": "lumpwatch", "newName": name, "newTag": tag}],
        },
        note,
    )


def _text(content: dict[str, Any], note: str) -> str:
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 110
    buffer = io.StringIO()
    yaml.dump(content, buffer)
    return f"{note}\n{buffer.getvalue()}"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: python -m {__spec__.name} CRUSHERS.yaml")
    try:
        write(Path(sys.argv[1]))
    except (OSError, ValueError, LumpwatchError) as error:
        sys.exit(str(error))
