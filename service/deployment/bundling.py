"""What a container is given: the configuration as it is now, with its certificates, secrets and limits.

The files travel in a volume of their own and not as a bind mount, so that the container kept for a
roll-back still has the configuration it was started with, and a remote engine serves as well as a local one.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import tarfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath

from lumpwatch.service.bus import SHARED_MEMORY_MIB
from lumpwatch.service.config import NetworkConfig, SiteConfig, parse_config, read_text, variables
from lumpwatch.service.errors import ConfigError

HOME = PurePosixPath("/etc/lumpwatch")
CONFIG = HOME / "site.yaml"
SECRETS = "secrets"
USER = 10001
"""User and group of the image."""
_SHM_LEAST_MIB = 64
_MEMORY_DAEMON_MIB, _MEMORY_CAMERA_MIB = 512, 1024
_LOOPBACK = ("127.", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class Bundle:
    """Everything about a container but its image."""

    site: str
    files: Mapping[str, bytes] = field(repr=False)
    """Content by path under `HOME`; holds secrets."""
    environment: Mapping[str, str]
    store: PurePosixPath
    """Where the daemon keeps its files, on a volume of the site."""
    footage: tuple[str, ...]
    """Paths of files and folders in the place of cameras, mounted at the same place, read-only."""
    network: str
    ports: tuple[str, ...]
    """Published where the network is not the host's: `9464/tcp`."""
    shm_mib: int
    memory_mib: int

    @property
    def name(self) -> str:
        """Name of the container in use."""
        return f"lumpwatch-{self.site}"

    @property
    def store_volume(self) -> str:
        """Name of the site's volume; it stays from container to container."""
        return f"{self.name}-store"

    @property
    def config_volume(self) -> str:
        """Name of the volume with this configuration."""
        return f"{self.name}-config-{self.digest[:12]}"

    @property
    def digest(self) -> str:
        """Fingerprint of everything above; slow to make, since it stands in a label and covers passwords."""
        content = asdict(self) | {"store": str(self.store)}
        content["files"] = {name: base64.b64encode(data).decode() for name, data in self.files.items()}
        text = json.dumps(content, sort_keys=True).encode()
        return hashlib.scrypt(text, salt=self.site.encode(), n=1 << 14, r=8, p=1, dklen=32).hex()

    def config_archive(self) -> bytes:
        """The files as a tar archive, readable by the daemon's user alone."""
        folders = {str(p) for name in self.files for p in PurePosixPath(name).parents if p.name}
        if self.store.is_relative_to(HOME):
            # The store's volume is mounted there, and this volume is read-only by then.
            folders |= {str(self.store.relative_to(HOME))}
        return _archive(folders, self.files)

    @staticmethod
    def store_archive() -> bytes:
        """An empty archive that gives the store's folder to the daemon's user."""
        return _archive({"."}, {})


def _archive(folders: set[str], files: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        for name in sorted(folders):
            entry = tarfile.TarInfo(name)
            entry.type, entry.mode, entry.uid, entry.gid = tarfile.DIRTYPE, 0o755, USER, USER
            tar.addfile(entry)
        for name, data in sorted(files.items()):
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode, entry.uid, entry.gid = len(data), 0o400, USER, USER
            tar.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def bundle(
    path: Path, network: str = "host", memory_mib: int | None = None, environ: Mapping[str, str] = os.environ
) -> Bundle:
    """Gather what the configuration file needs. Raises ConfigError, also for what cannot work in a container."""
    text = read_text(path)
    config = parse_config(text, str(path), environ)
    files = {CONFIG.name: text.encode()} | _beside(config, path.parent)
    environment: dict[str, str] = {}
    for name, value in variables(text, environ).items():
        # As files: what stands in the environment is shown to whoever may inspect the container.
        files[f"{SECRETS}/{name}"] = value.encode()
        environment[f"{name}_FILE"] = str(HOME / SECRETS / name)
    store = HOME / PurePosixPath(config.store.path)
    environment["NUMBA_CACHE_DIR"] = str(store / "kernels")
    if level := environ.get("LUMPWATCH_LOG_LEVEL"):
        environment["LUMPWATCH_LOG_LEVEL"] = level
    return Bundle(
        site=config.site,
        files=files,
        environment=environment,
        store=store,
        footage=_footage(config),
        network=network,
        ports=() if network == "host" else _ports(config),
        shm_mib=max(_SHM_LEAST_MIB, SHARED_MEMORY_MIB * len(config.cameras)),
        memory_mib=memory_mib or _MEMORY_DAEMON_MIB + _MEMORY_CAMERA_MIB * len(config.cameras),
    )


def _beside(config: SiteConfig, folder: Path) -> dict[str, bytes]:
    """The files that the configuration names: certificates, and networks of one's own."""
    tls = config.bus.tls
    named: list[tuple[str, Path]] = []
    if tls is not None:
        named += [("bus.tls.ca", tls.ca), ("bus.tls.certificate", tls.certificate), ("bus.tls.key", tls.key)]
    for camera in config.cameras:
        for roi in camera.rois:
            likelihood = getattr(roi.detector, "likelihood", None)
            if isinstance(likelihood, NetworkConfig):
                named.append((f"camera {camera.id}, roi {roi.id}: model", likelihood.model))
    found = {}
    for key, file in named:
        if file.is_absolute() or ".." in file.parts:
            raise ConfigError(f"{key} {file}: name it relative to the configuration file, and below it")
        try:
            found[file.as_posix()] = (folder / file).read_bytes()
        except OSError as error:
            raise ConfigError(f"{key} {folder / file}: cannot be read ({error.strerror})") from error
    return found


def _footage(config: SiteConfig) -> tuple[str, ...]:
    found = []
    for camera in config.cameras:
        if camera.source.kind not in ("video", "images"):
            continue
        if not camera.source.path.is_absolute():
            raise ConfigError(
                f"camera {camera.id}: source.url {camera.source.path}: a container needs an absolute path"
            )
        found.append(str(camera.source.path))
    return tuple(dict.fromkeys(found))


def _ports(config: SiteConfig) -> tuple[str, ...]:
    """What a container in a network of its own serves; loopback would be its own, and nobody's."""
    served = [("telemetry.listen", config.telemetry.listen, "tcp")]
    if config.bus.mode == "router":
        for endpoint in config.bus.listen:
            scheme, _, rest = endpoint.partition("/")
            if scheme != "unixsock-stream":
                address = rest.partition("/")[0]
                served.append(("bus.listen", address, "udp" if scheme in ("udp", "quic") else "tcp"))
    ports = []
    for key, address, protocol in served:
        host, _, port = address.rpartition(":")
        if host.strip("[]").startswith(_LOOPBACK):
            raise ConfigError(
                f"{key} {address}: loopback cannot be reached from outside a container's own network; "
                "listen on 0.0.0.0, or leave --network host"
            )
        ports.append(f"{port}/{protocol}")
    return tuple(dict.fromkeys(ports))
