"""The container engine behind a Docker-compatible socket (Docker, Podman); the only user of the SDK."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import docker
import docker.errors
import requests

from lumpwatch.service.deployment.bundling import CONFIG, HOME, Bundle
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.deployment.plan import Found, cause

_LABEL = "io.lumpwatch."
_STOP_S = 15
_LONGEST_OUTPUT = 400
"""How much of an engine's words is repeated."""
_LOG = {"type": "json-file", "config": {"max-size": "10m", "max-file": "3"}}


def connect(socket: str | None = None, environ: Mapping[str, str] = os.environ) -> DockerEngine:
    """The engine at `socket`, at `DOCKER_HOST`, or at the first usual place where one answers."""
    named = socket or environ.get("DOCKER_HOST")
    runtime = environ.get("XDG_RUNTIME_DIR", f"/run/user/{os.getuid()}")
    usual = ("/var/run/docker.sock", f"{runtime}/podman/podman.sock", "/run/podman/podman.sock")
    tried = []
    for place in (named,) if named else usual:
        url = place if "://" in place else f"unix://{place}"
        if not named and not Path(place).exists():
            tried.append(f"{place}: does not exist")
            continue
        try:
            client = docker.DockerClient(base_url=url, version="auto", timeout=120)
            client.ping()
        except (docker.errors.DockerException, requests.RequestException, ValueError) as error:
            tried.append(f"{place}: {_reason(error)}")
            continue
        return DockerEngine(client)
    raise DeployError(
        f"no container engine answers ({'; '.join(tried)}); start Docker, or Podman's by "
        "`systemctl start podman.socket`, or name its socket by --socket or DOCKER_HOST"
    )


class DockerEngine:
    """An engine reached by the Docker SDK."""

    def __init__(self, client: docker.DockerClient) -> None:
        self._client = client

    def image(self, reference: str, pull: bool = False) -> str:
        """Id of the image; pulled where the engine does not have it, or `pull` asks for it."""
        try:
            if not pull:
                return str(self._client.images.get(reference).id)
        except docker.errors.ImageNotFound:
            pass
        except (docker.errors.DockerException, requests.RequestException) as error:
            raise DeployError(f"image {reference}: {_reason(error)}") from error
        try:
            return str(self._client.images.pull(*name_and_tag(reference)).id)
        except (docker.errors.DockerException, requests.RequestException) as error:
            raise DeployError(
                f"image {reference}: the engine does not have it and cannot pull it ({_reason(error)}); "
                "name another by --image, or build it by --build"
            ) from error

    def build(self, folder: Path, reference: str, arguments: Mapping[str, str]) -> str:
        """Build the folder's Dockerfile; the image's id."""
        try:
            image, _ = self._client.images.build(
                path=str(folder), tag=reference, buildargs=dict(arguments), rm=True
            )
        except docker.errors.BuildError as error:
            said = [str(line["stream"]).strip() for line in error.build_log if line.get("stream")]
            # The end of it has the cause; the error itself only repeats the whole instruction.
            tail = " ".join(" ".join(said[-3:] or [str(error)]).split())
            raise DeployError(f"{folder}: build failed: {tail[-_LONGEST_OUTPUT:]}") from error
        except (docker.errors.DockerException, requests.RequestException, TypeError) as error:
            raise DeployError(f"{folder}: cannot be built ({_reason(error)})") from error
        return str(image.id)

    def found(self, name: str) -> Found | None:
        """See `rollout.Engine`."""
        try:
            attrs = self._client.containers.get(name).attrs
        except docker.errors.NotFound:
            return None
        except (docker.errors.DockerException, requests.RequestException) as error:
            raise DeployError(f"container {name}: {_reason(error)}") from error
        labels = attrs["Config"].get("Labels") or {}
        return Found(
            name=name,
            image=attrs["Image"],
            digest=labels.get(f"{_LABEL}digest", ""),
            status=attrs["State"]["Status"],
            since=attrs["State"].get("StartedAt", ""),
            restarts=attrs.get("RestartCount", 0),
            config_volume=labels.get(f"{_LABEL}config", ""),
        )

    def prepare(self, image: str, bundle: Bundle) -> None:
        """See `rollout.Engine`."""
        volumes = {
            bundle.config_volume: {"bind": str(HOME), "mode": "rw"},
            bundle.store_volume: {"bind": str(bundle.store), "mode": "rw"},
        }
        with _docker_errors(f"volumes of {bundle.name}"):
            # Never started: volumes can be filled through a container only.
            helper = self._client.containers.create(image, ["--version"], volumes=volumes)
            try:
                helper.put_archive(str(HOME), bundle.config_archive())
                helper.put_archive(str(bundle.store), bundle.store_archive())
            finally:
                helper.remove(v=True)

    def complaint(self, image: str, bundle: Bundle) -> str | None:
        """See `rollout.Engine`."""
        with _docker_errors("lumpwatch check in the image"):
            options = _options(bundle) | {"network_mode": "none", "restart_policy": None, "ports": None}
            container = self._client.containers.create(image, ["check", str(CONFIG)], **options)
            try:
                container.start()
                code = container.wait(timeout=60)["StatusCode"]
                lines = container.logs().decode(errors="replace").splitlines()
            finally:
                container.remove(v=True, force=True)
        return cause(lines) if code else None

    def create(self, name: str, image: str, bundle: Bundle) -> None:
        """See `rollout.Engine`."""
        labels = {"site": bundle.site, "digest": bundle.digest, "config": bundle.config_volume}
        with _docker_errors(f"container {name}"):
            self._client.containers.create(
                image,
                ["run", str(CONFIG)],
                name=name,
                labels={f"{_LABEL}{key}": value for key, value in labels.items()},
                **_options(bundle),
            )

    def start(self, name: str) -> None:
        """See `rollout.Engine`."""
        with _docker_errors(f"container {name}"):
            self._client.containers.get(name).start()

    def stop(self, name: str) -> None:
        """See `rollout.Engine`."""
        with _docker_errors(f"container {name}"):
            self._client.containers.get(name).stop(timeout=_STOP_S)

    def rename(self, name: str, new: str) -> None:
        """See `rollout.Engine`."""
        with _docker_errors(f"container {name}"):
            self._client.containers.get(name).rename(new)

    def remove(self, name: str) -> None:
        """See `rollout.Engine`."""
        found = self.found(name)
        if found is None:
            return
        with _docker_errors(f"container {name}"):
            self._client.containers.get(name).remove(v=True, force=True)
        if found.config_volume:
            try:
                self._client.volumes.get(found.config_volume).remove()
            except docker.errors.APIError:
                return  # another container has the same configuration

    def health(self, name: str) -> list[str] | None:
        """See `rollout.Engine`."""
        try:
            code, output = self._client.containers.get(name).exec_run(["lumpwatch", "health", str(CONFIG)])
        except docker.errors.APIError:
            return None  # it is not running any more
        lines = output.decode(errors="replace").splitlines()
        if code == 0:
            return []
        return None if not lines or lines[0].startswith("lumpwatch: ") else lines

    def logs(self, name: str, tail: int) -> list[str]:
        """See `rollout.Engine`."""
        with _docker_errors(f"container {name}"):
            text = self._client.containers.get(name).logs(tail=tail)
        return text.decode(errors="replace").splitlines()

    def follow(self, name: str, tail: int) -> Iterator[bytes]:
        """The log as it is written."""
        with _docker_errors(f"container {name}"):
            yield from self._client.containers.get(name).logs(stream=True, follow=True, tail=tail)


def _options(bundle: Bundle) -> dict[str, Any]:
    """How every container of the daemon is started: nothing that it does not need."""
    volumes = {
        bundle.config_volume: {"bind": str(HOME), "mode": "ro"},
        bundle.store_volume: {"bind": str(bundle.store), "mode": "rw"},
    }
    return {
        "volumes": volumes | {path: {"bind": path, "mode": "ro"} for path in bundle.footage},
        "environment": dict(bundle.environment),
        "network_mode": bundle.network,
        "ports": {port: int(port.partition("/")[0]) for port in bundle.ports} or None,
        "read_only": True,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges"],
        "tmpfs": {"/tmp": "size=64m,mode=1777"},
        "shm_size": f"{bundle.shm_mib}m",
        "mem_limit": f"{bundle.memory_mib}m",
        "pids_limit": 1024,
        "restart_policy": {"Name": "unless-stopped"},
        "log_config": _LOG,
    }


def name_and_tag(reference: str) -> tuple[str, str | None]:
    """`host:5000/name:tag` in its two parts; without a tag, `latest` and not all of them."""
    name, colon, tag = reference.rpartition(":")
    if "@" in reference:
        return reference, None
    return (name, tag) if colon and "/" not in tag else (reference, "latest")


@contextmanager
def _docker_errors(what: str) -> Iterator[None]:
    """The SDK's errors as one line about `what`."""
    try:
        yield
    except docker.errors.NotFound as error:
        raise DeployError(f"{what}: does not exist ({_reason(error)})") from error
    except (docker.errors.DockerException, requests.RequestException) as error:
        raise DeployError(f"{what}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    text = getattr(error, "explanation", None) or str(error)
    return _one_line([text.decode(errors="replace") if isinstance(text, bytes) else str(text)])


def _one_line(lines: list[str]) -> str:
    return " ".join(" ".join(lines).split())[:_LONGEST_OUTPUT]
