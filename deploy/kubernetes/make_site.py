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
import re
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
_TLS = {"ca": f"{_SECRETS}/ca.crt", "certificate": f"{_SECRETS}/tls.crt", "key": f"{_SECRETS}/tls.key"}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Outside(_Strict):
    """A way for alarms to leave the cluster."""

    network: str = Field(pattern=_CIDR)
    """Whose clients are let in."""
    kind: Literal["LoadBalancer", "NodePort"] = "LoadBalancer"
    node_port: int | None = Field(default=None, ge=30000, le=32767)


class Gateway(_Strict):
    """Values and signals for the plant's control system: a pod of its own, with a certificate of its own."""

    network: str = Field(pattern=_CIDR)
    """Of the PLC: who may connect to Modbus TCP."""
    kind: Literal["LoadBalancer", "NodePort"] = "LoadBalancer"
    node_port: int | None = Field(default=None, ge=30000, le=32767)
    broker: str | None = Field(default=None, pattern=_CIDR)
    """Of the MQTT broker, where `more` has one."""
    more: dict[str, Any] = Field(default_factory=dict)
    """Other keys of the section `gateway` of `site.yaml`."""

    @model_validator(mode="after")
    def _reached(self) -> Self:
        if "opcua" in self.more:
            raise ValueError("opcua: the image does not hold its library")
        if (self.broker is None) != ("mqtt" not in self.more):
            raise ValueError("broker (a network) and more.mqtt belong together")
        return self


class Crusher(_Strict):
    """One camera, one workload."""

    network: str = Field(pattern=_CIDR)
    """Where its camera is, for the network policy."""
    camera: dict[str, Any]
    """As in `site.yaml`; its id names the workload."""
    outside: Outside | None = None
    gateway: Gateway | None = None
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
        if crusher.gateway is not None:
            beside = _text(_gateway_config(site, crusher, crusher.gateway), note)
            parse_config(beside, f"{place}: {crusher.name}: gateway", secrets=False)
            written[folder / "gateway.yaml"] = beside
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
    config = {
        "site": site.namespace,
        "telemetry": {"listen": "0.0.0.0:9464"},
        "bus": {"listen": ["tls/0.0.0.0:7447"], "tls": _TLS},
        "store": {"path": "/var/lib/lumpwatch"},
        **console,
        **crusher.more,
        "cameras": [crusher.camera],
    }
    if crusher.gateway is not None:
        config["bus"] = _letting_in(config["bus"], f"gateway-{crusher.name}")
    return config


def _letting_in(bus: dict[str, Any], gateway: str) -> dict[str, Any]:
    """The daemon's bus with the gateway among those that may acknowledge."""
    access = bus.get("access") or {}
    gateways = [*access.get("gateways", ()), *([] if gateway in access.get("gateways", ()) else [gateway])]
    return {**bus, "access": {**access, "gateways": gateways}}


def _gateway_config(site: Site, crusher: Crusher, gateway: Gateway) -> dict[str, Any]:
    """What the gateway reads: the same regions, the way to the daemon's bus, and nothing that is secret."""
    source = {"url": re.sub(r"//[^/@]*@", "//", str(crusher.camera.get("source", {}).get("url")))}
    modbus = {"listen": "0.0.0.0:5020", "clients": [gateway.network], **gateway.more.get("modbus", {})}
    return {
        "site": site.namespace,
        "bus": {"mode": "client", "connect": [f"tls/lumpwatch-{crusher.name}:7447"], "tls": _TLS},
        "gateway": {**gateway.more, "modbus": modbus},
        "cameras": [{**crusher.camera, "source": source}],
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
    patches.append(
        {"target": {"kind": "NetworkPolicy", "name": "lumpwatch"}, "patch": Block("\n".join(policy) + "\n")}
    )
    maps: list[dict[str, Any]] = [{"name": "lumpwatch", "behavior": "replace", "files": ["site.yaml"]}]
    if crusher.gateway is not None:
        parts.append(f"{base}/gateway")
        maps.append({"name": "lumpwatch-gateway", "files": ["site.yaml=gateway.yaml"]})
        patches += _gateway_patches(name, crusher.gateway)
    return _text(
        {
            "apiVersion": "kustomize.config.k8s.io/v1beta1",
            "kind": "Kustomization",
            "resources": [f"{base}/base"],
            **({"components": parts} if parts else {}),
            "nameSuffix": f"-{name}",
            "labels": [{"pairs": {"lumpwatch.io/camera": name}, "includeSelectors": True}],
            "configMapGenerator": maps,
            "patches": patches,
        },
        note,
    )


def _gateway_patches(name: str, gateway: Gateway) -> list[dict[str, Any]]:
    secret = (
        f"- {{op: replace, path: /spec/template/spec/volumes/1/secret/secretName, value: gateway-{name}}}"
    )
    service = [f"- {{op: replace, path: /spec/type, value: {gateway.kind}}}"]
    if gateway.node_port is not None:
        service.append(f"- {{op: add, path: /spec/ports/0/nodePort, value: {gateway.node_port}}}")
    policy = [f"- {{op: replace, path: /spec/ingress/0/from/0/ipBlock/cidr, value: {gateway.network}}}"]
    if gateway.broker is not None:
        port = str(gateway.more.get("mqtt", {}).get("broker", "")).rpartition(":")[2]
        to = f"{{to: [{{ipBlock: {{cidr: {gateway.broker}}}}}], ports: [{{port: {port}, protocol: TCP}}]}}"
        policy.append(f"- {{op: add, path: /spec/egress/-, value: {to}}}")
    return [
        {"target": {"kind": kind, "name": "lumpwatch-gateway"}, "patch": Block("\n".join(lines) + "\n")}
        for kind, lines in (("Deployment", [secret]), ("Service", service), ("NetworkPolicy", policy))
    ]


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
