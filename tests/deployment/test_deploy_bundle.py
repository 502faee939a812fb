"""What a container is given, and what an engine is asked for."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config.load import site_name
from lumpwatch.service.deployment.bundling import USER, Bundle, bundle
from lumpwatch.service.deployment.engine import connect, name_and_tag
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.errors import ConfigError
from tests.integration.site import free_port
from tests.service_helpers import site_tree


def write(folder: Path, url: str = "rtsp://u:${CAM_PASSWORD}@10.0.0.5/s", **top: Any) -> Path:
    tree = site_tree() | top
    tree["cameras"][0]["source"]["url"] = url
    (folder / "site.yaml").write_text(json.dumps(tree))
    return folder / "site.yaml"


def entries(archive: bytes) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        return {one.name: one for one in tar.getmembers()}


def test_secrets_travel_as_files_and_never_in_the_environment(tmp_path: Path) -> None:
    (tmp_path / "pw").write_text("geheim\n")
    for environ in ({"CAM_PASSWORD": "geheim"}, {"CAM_PASSWORD_FILE": str(tmp_path / "pw")}):
        made = bundle(write(tmp_path), environ=environ)
        assert made.files["secrets/CAM_PASSWORD"] == b"geheim"
        assert made.environment["CAM_PASSWORD_FILE"] == "/etc/lumpwatch/secrets/CAM_PASSWORD"
        assert "geheim" not in repr(made)
        found = entries(made.config_archive())
        assert (found["secrets/CAM_PASSWORD"].mode, found["secrets/CAM_PASSWORD"].uid) == (0o400, USER)
        # The store's volume is mounted inside: its place has to be there.
        assert found["var"].isdir()


def test_the_fingerprint_is_that_of_everything_given(tmp_path: Path) -> None:
    environ = {"CAM_PASSWORD": "a"}
    path = write(tmp_path)
    first = bundle(path, environ=environ)
    assert bundle(path, environ=environ).digest == first.digest
    others = [
        bundle(path, environ={"CAM_PASSWORD": "b"}),
        bundle(path, memory_mib=2048, environ=environ),
        bundle(write(tmp_path, store={"path": "/srv/lump"}), environ=environ),
    ]
    assert len({first.digest, *(one.digest for one in others)}) == 4
    assert others[-1].store.as_posix() == "/srv/lump"
    assert others[-1].environment["NUMBA_CACHE_DIR"] == "/srv/lump/kernels"


def test_limits_follow_the_number_of_cameras(tmp_path: Path) -> None:
    path = write(tmp_path, "sim:feed")
    assert (bundle(path, environ={}).shm_mib, bundle(path, environ={}).memory_mib) == (64, 1536)
    tree = json.loads(path.read_text())
    tree["cameras"] = [tree["cameras"][0] | {"id": f"c{i}"} for i in range(4)]
    path.write_text(json.dumps(tree))
    made = bundle(path, environ={})
    assert (made.shm_mib, made.memory_mib) == (144, 4608)


def test_certificates_travel_and_must_lie_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "certs").mkdir()
    for name in ("ca", "own", "key"):
        (tmp_path / "certs" / name).write_text(name)
    tls = {"ca": "certs/ca", "certificate": "certs/own", "key": "certs/key"}
    bus: dict[str, Any] = {"listen": ["tls/0.0.0.0:7447"], "tls": tls}
    made = bundle(write(tmp_path, "sim:feed", bus=bus), environ={})
    assert {made.files[f"certs/{name}"] for name in ("ca", "own", "key")} == {b"ca", b"own", b"key"}
    for wrong in ("/etc/ca.pem", "../ca.pem"):
        bus["tls"] = tls | {"ca": wrong}
        with pytest.raises(ConfigError, match=r"bus\.tls\.ca .*relative"):
            bundle(write(tmp_path, "sim:feed", bus=bus), environ={})
    bus["tls"] = tls | {"key": "certs/missing"}
    with pytest.raises(ConfigError, match=r"bus\.tls\.key .*cannot be read"):
        bundle(write(tmp_path, "sim:feed", bus=bus), environ={})


def test_a_network_of_ones_own_travels_too(tmp_path: Path) -> None:
    file = write(tmp_path, "sim:feed")
    tree = json.loads(file.read_text())
    likelihood = {"kind": "network", "model": "nets/lumps.onnx"}
    tree["cameras"][0]["rois"][0]["detector"] = {"kind": "jdt", "likelihood": likelihood}
    file.write_text(json.dumps(tree))
    with pytest.raises(ConfigError, match=r"roi apron: .*lumps\.onnx: cannot be read"):
        bundle(file, environ={})
    (tmp_path / "nets").mkdir()
    (tmp_path / "nets" / "lumps.onnx").write_bytes(b"a network")
    assert bundle(file, environ={}).files["nets/lumps.onnx"] == b"a network"


def test_ports_are_those_of_the_configuration(tmp_path: Path) -> None:
    def on_bridge(**top: Any) -> Bundle:
        return bundle(write(tmp_path, "sim:feed", **top), network="bridge", environ={})

    open_to_all = {"telemetry": {"listen": "0.0.0.0:9464"}}
    assert on_bridge(
        **open_to_all, bus={"listen": ["tcp/0.0.0.0:7447", "udp/0.0.0.0:7448"], "insecure": True}
    ).ports == (
        "9464/tcp",
        "7447/tcp",
        "7448/udp",
    )
    with pytest.raises(ConfigError, match=r"telemetry\.listen 127.0.0.1:9464: loopback"):
        on_bridge()
    with pytest.raises(ConfigError, match=r"bus\.listen 127.0.0.1:7447: loopback"):
        on_bridge(**open_to_all)
    assert bundle(write(tmp_path, "sim:feed"), environ={}).ports == ()


def test_footage_needs_an_absolute_path(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="absolute path"):
        bundle(write(tmp_path, "clip.mp4"), environ={})
    assert bundle(write(tmp_path, "/data/clip.mp4"), environ={}).footage == ("/data/clip.mp4",)


def test_the_site_is_known_without_its_secrets(tmp_path: Path) -> None:
    assert site_name(write(tmp_path)) == "pit"
    (tmp_path / "bad.yaml").write_text("site: [1]\n")
    with pytest.raises(ConfigError, match=r"bad\.yaml: site: "):
        site_name(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("reference", "parts"),
    [
        ("lumpwatch", ("lumpwatch", "latest")),
        ("lumpwatch:0.1.0", ("lumpwatch", "0.1.0")),
        ("host:5000/lumpwatch", ("host:5000/lumpwatch", "latest")),
        ("host:5000/lumpwatch:1", ("host:5000/lumpwatch", "1")),
        ("lumpwatch@sha256:ab", ("lumpwatch@sha256:ab", None)),
    ],
)
def test_image_references(reference: str, parts: tuple[str, str | None]) -> None:
    assert name_and_tag(reference) == parts


def test_no_engine_is_one_line_that_says_where_was_looked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "no.sock"
    assert main(["deploy", "up", str(write(tmp_path, "sim:feed")), "--socket", str(missing)]) == 1
    told = capsys.readouterr().err
    assert str(missing) in told
    assert "no container engine answers" in told
    assert len(told.splitlines()) == 1
    with pytest.raises(DeployError, match="no container engine answers"):
        connect(environ={"DOCKER_HOST": f"tcp://127.0.0.1:{free_port()}"})
    assert main(["deploy", "up", str(tmp_path / "none.yaml")]) == 2
    assert main(["deploy"]) == 2
