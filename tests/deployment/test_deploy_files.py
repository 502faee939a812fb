"""What `deploy/` holds is valid by the published schemas, and keeps what the docs promise of it."""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from deploy.kubernetes.make_rules import TARGET, text
from deploy.kubernetes.make_site import files_of, write
from deploy.kubernetes.make_site import read as read_site
from lumpwatch.service.bus import SHARED_MEMORY_MIB
from lumpwatch.service.capture import spec_of
from lumpwatch.service.cli.arguments import backtest
from lumpwatch.service.config import parse_config
from lumpwatch.service.deployment.bundling import CONFIG, USER
from lumpwatch.service.errors import ConfigError

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "deploy/compose/compose.yaml"
KUBERNETES = ROOT / "deploy/kubernetes"
CONFIGS = [
    *sorted((ROOT / "deploy/compose").glob("*.yaml")),
    *sorted(KUBERNETES.rglob("site.yaml")),
]


CRUSHER = {
    "network": "10.0.0.5/32",
    "camera": {
        "id": "a",
        "source": {"url": "rtsp://10.0.0.5/stream"},
        "rois": [{"id": "apron", "polygon": [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9]]}],
    },
}


def site_of(*names: str) -> dict[str, Any]:
    """A list of crushers."""
    crushers = [{**CRUSHER, "camera": {**CRUSHER["camera"], "id": name}} for name in names]  # type: ignore[dict-item]
    return {"namespace": "pit", "image": "registry.example/lumpwatch:1", "crushers": crushers}


def read(path: Path) -> Any:
    return YAML(typ="safe", pure=True).load(path.read_text())


def mib(text: str) -> int:
    number, unit = re.fullmatch(r"(?:\$\{\w+:-)?(\d+)([mgMG])i?\}?", text).groups()  # type: ignore[union-attr]
    return int(number) * {"m": 1, "g": 1024}[unit.lower()]


@pytest.mark.parametrize(
    "path", [p for p in CONFIGS if p != COMPOSE], ids=lambda p: str(p.relative_to(ROOT / "deploy"))
)
def test_configurations_are_valid_and_reachable_in_a_container(path: Path) -> None:
    config = parse_config(path.read_text(), path.name, {"CAM_PASSWORD": "x"})
    assert config.telemetry.address == ("0.0.0.0", 9464)
    in_cluster = KUBERNETES in path.parents
    assert config.bus.listen == (("tls" if in_cluster else "tcp") + "/0.0.0.0:7447",)
    assert (config.bus.tls is not None) is in_cluster
    assert str(config.store.path) == "/var/lib/lumpwatch"


def test_examples_are_valid() -> None:
    for path in sorted((ROOT / "deploy/examples").glob("*.yaml")):
        config = parse_config(path.read_text(), path.name, {"CAM_PASSWORD": "x"})
        for camera in config.cameras:
            spec_of(camera.source, camera.id)
    assert {roi.watch for roi in config.cameras[0].rois} == {"belt", "mouth"}


def test_compose_is_valid_by_the_schema() -> None:
    pytest.importorskip("check_jsonschema", reason="check-jsonschema is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec", str(COMPOSE)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", list(read(COMPOSE)["services"]))
def test_every_service_of_compose_is_hardened_and_limited(name: str) -> None:
    service = read(COMPOSE)["services"][name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert mib(service["mem_limit"]) >= 64
    assert service["pids_limit"] > 0
    assert service["restart"] == ("no" if name == "footage" else "unless-stopped")
    assert name == "lumpwatch" or "healthcheck" in service  # lumpwatch: the image's own
    for port in service.get("ports", []):
        assert port.startswith("127.0.0.1:"), "published beyond loopback"
    assert "@" in service["image"] or ":" in service["image"].rpartition("/")[2]


def test_compose_refers_to_what_exists() -> None:
    compose = read(COMPOSE)
    for name, service in compose["services"].items():
        for volume in service.get("volumes", []):
            source = volume["source"] if isinstance(volume, dict) else volume.partition(":")[0]
            source = re.sub(r"^\$\{\w+:-(.*)\}$", r"\1", source)
            if source.startswith("./"):
                assert (COMPOSE.parent / source).exists(), f"{name}: {source}"
            elif not source.startswith("../"):
                assert source in compose["volumes"], f"{name}: {source}"
        for other in service.get("depends_on", []):
            assert other in compose["services"]
    datasource = read(COMPOSE.parent / "grafana/datasource.yaml")["datasources"][0]
    assert datasource["uid"] == "prometheus"
    assert datasource["url"] == "http://prometheus:9090"
    cameras = len(parse_config((COMPOSE.parent / "site.yaml").read_text()).cameras)
    assert mib(compose["services"]["lumpwatch"]["shm_size"]) >= SHARED_MEMORY_MIB * cameras


@pytest.fixture(scope="module")
def rendered() -> list[dict[str, Any]]:
    """The objects of the example: rendered, or the base's files where kubectl is missing."""
    if (kubectl := shutil.which("kubectl")) is None:
        return [read(path) for path in (KUBERNETES / "base").glob("*.yaml") if "apiVersion" in read(path)]
    done = subprocess.run(
        [kubectl, "kustomize", str(KUBERNETES / "example")], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return list(YAML(typ="safe", pure=True).load_all(done.stdout))


def test_kubernetes_objects_are_valid_by_the_schema(rendered: list[dict[str, Any]]) -> None:
    validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
    own = [
        one for one in rendered if one["kind"] not in ("ServiceMonitor", "PrometheusRule", "Kustomization")
    ]
    assert {one["kind"] for one in own} >= {"StatefulSet", "Service", "PodDisruptionBudget", "NetworkPolicy"}
    for one in own:
        validate.validate(one, validate.latest_version(), strict=True)


def test_the_jobs_of_a_backtest_are_valid_hardened_and_understood() -> None:
    """Both look at the same archive and the same results; as many shares as completions, each by its index."""
    validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
    parser = argparse.ArgumentParser()
    backtest.add(parser.add_subparsers())
    asked = {}
    for name in ("backtest", "report"):
        job = read(KUBERNETES / "batch" / f"{name}.yaml")
        validate.validate(job, validate.latest_version(), strict=True)
        pod = job["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsUser"] == USER
        (container,) = pod["containers"]
        assert container["securityContext"]["readOnlyRootFilesystem"] is True
        assert {m["name"] for m in container["volumeMounts"]} == {v["name"] for v in pod["volumes"]}
        asked[name] = parser.parse_args([one.replace("$(INDEX)", "99") for one in container["args"]])
        if name == "backtest":
            assert asked[name].share.count == job["spec"]["completions"]
            assert container["env"][0]["name"] == "INDEX"
            assert asked[name].worker_mb < mib(container["resources"]["limits"]["memory"])
    assert asked["backtest"].resume == asked["report"].resume
    assert asked["backtest"].videos == asked["report"].videos
    assert asked["report"].share is None


def test_a_workload_is_hardened_probed_and_has_what_the_daemon_needs(rendered: list[dict[str, Any]]) -> None:
    workloads = [one for one in rendered if one["kind"] == "StatefulSet"]
    assert workloads
    for workload in workloads:
        assert workload["spec"]["replicas"] == 1
        pod = workload["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["runAsUser"] == USER
        assert pod["automountServiceAccountToken"] is False
        container = pod["containers"][0]
        for one in pod["containers"]:
            assert one["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            }
            assert one["args"][-1] == str(CONFIG)
            assert one["resources"]["limits"]["memory"]
        pages = {kind: container[f"{kind}Probe"]["httpGet"] for kind in ("startup", "liveness", "readiness")}
        assert {kind: page["path"] for kind, page in pages.items()} == {
            "startup": "/livez",  # a camera that is down must not restart the daemon that says so
            "liveness": "/livez",
            "readiness": "/readyz",
        }
        assert {page["port"] for page in pages.values()} == {"metrics"}
        mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
        volumes = {volume["name"]: volume for volume in pod["volumes"]}
        claims = {claim["metadata"]["name"] for claim in workload["spec"]["volumeClaimTemplates"]}
        used = {mount["name"] for one in pod["containers"] for mount in one["volumeMounts"]}
        assert used == set(volumes) | claims
        assert mounts["store"] == "/var/lib/lumpwatch"
        assert mounts["shm"] == "/dev/shm"
        assert volumes["shm"]["emptyDir"]["medium"] == "Memory"
        assert mib(volumes["shm"]["emptyDir"]["sizeLimit"].replace("i", "")) >= SHARED_MEMORY_MIB


def test_the_console_is_beside_one_daemon_with_its_store_and_reached_by_the_ingress_alone(
    rendered: list[dict[str, Any]],
) -> None:
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl is not installed")
    found = {
        one["metadata"]["name"]: {c["name"]: c for c in one["spec"]["template"]["spec"]["containers"]}
        for one in rendered
        if one["kind"] == "StatefulSet"
    }
    assert [len(found[name]) for name in sorted(found)] == [2, 1]
    first = found["lumpwatch-crusher-1"]
    assert first["console"]["args"][0] == "console"
    assert first["console"]["image"] == first["lumpwatch"]["image"]
    paths = [{m["name"]: m["mountPath"] for m in c["volumeMounts"]} for c in first.values()]
    assert paths[0]["store"] == paths[1]["store"]
    for one in rendered:
        ours = one["metadata"]["name"] == "lumpwatch-crusher-1"
        if one["kind"] == "Service":
            ports = {port["name"] for port in one["spec"]["ports"]}
            assert ("console" in ports) is ours
        elif one["kind"] == "NetworkPolicy":
            lets_in = [rule for rule in one["spec"]["ingress"] if rule["ports"][0]["port"] == "console"]
            assert len(lets_in) == ours
            for rule in lets_in:
                assert [list(source) for source in rule["from"]] == [["namespaceSelector"]]
    config = parse_config(
        (KUBERNETES / "example/crusher-1/site.yaml").read_text(), "site", {"CAM_PASSWORD": "x"}
    )
    assert config.console.address == ("0.0.0.0", 8080)
    assert config.console.users is not None


def test_the_gateway_is_a_pod_of_its_own_with_its_certificate_and_let_in_from_the_plc_alone(
    rendered: list[dict[str, Any]],
) -> None:
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl is not installed")
    own = {one["kind"]: one for one in rendered if "gateway" in one["metadata"]["name"]}
    assert own.keys() == {"ConfigMap", "Deployment", "Service", "NetworkPolicy"}
    workload = own["Deployment"]["spec"]
    assert workload["replicas"] == 1
    assert workload["strategy"] == {"type": "Recreate"}  # never two heartbeats at one address
    assert workload["selector"]["matchLabels"].items() <= workload["template"]["metadata"]["labels"].items()
    pod = workload["template"]["spec"]
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert pod["securityContext"]["runAsUser"] == USER
    assert pod["automountServiceAccountToken"] is False
    (container,) = pod["containers"]
    assert container["args"] == ["gateway", str(CONFIG)]
    assert container["image"] == "registry.example/lumpwatch:0.1.0"
    assert container["securityContext"]["readOnlyRootFilesystem"] is True
    assert {mount["name"] for mount in container["volumeMounts"]} == {one["name"] for one in pod["volumes"]}
    volumes = {volume["name"]: volume for volume in pod["volumes"]}
    assert volumes["bus"]["secret"]["secretName"] == "gateway-crusher-1"
    assert "env" not in container  # it opens no camera
    # What it reads: the daemon's regions, the daemon's service, and no secret.
    assert volumes["config"]["configMap"]["name"] == own["ConfigMap"]["metadata"]["name"]
    config = parse_config(own["ConfigMap"]["data"]["site.yaml"], "gateway", {})
    services = {one["metadata"]["name"] for one in rendered if one["kind"] == "Service"}
    (joins,) = config.bus.joined
    assert joins.removeprefix("tls/").removesuffix(":7447") in services
    assert config.gateway.modbus is not None
    assert config.gateway.modbus.address[1] == container["ports"][0]["containerPort"]
    daemon = parse_config(
        (KUBERNETES / "example/crusher-1/site.yaml").read_text(), "site", {"CAM_PASSWORD": "x"}
    )
    assert [c.rois for c in config.cameras] == [c.rois for c in daemon.cameras]
    assert daemon.bus.access is not None
    assert daemon.bus.access.gateways == ("gateway-crusher-1",)
    # Who may come, and where it may go.
    policy = own["NetworkPolicy"]["spec"]
    (rule,) = policy["ingress"]
    assert rule["from"] == [{"ipBlock": {"cidr": str(config.gateway.modbus.clients[0])}}]
    assert own["Service"]["spec"]["externalTrafficPolicy"] == "Local"
    to = policy["egress"][1]["to"][0]["podSelector"]["matchLabels"]
    (bus,) = [
        one["metadata"]["name"]
        for one in rendered
        if one["kind"] == "StatefulSet"
        and to.items() <= one["spec"]["template"]["metadata"]["labels"].items()
    ]
    assert bus == "lumpwatch-crusher-1"
    assert workload["template"]["metadata"]["labels"]["lumpwatch.io/bus"] == "client"  # the daemon's policy


def test_the_gateway_of_a_list_has_a_way_to_its_broker_and_keeps_who_is_let_in_already(
    tmp_path: Path,
) -> None:
    listed = site_of("a")
    bus = {"listen": ["tls/0.0.0.0:7447"], "tls": {"ca": "a", "certificate": "b", "key": "c"}}
    listed["crushers"][0] |= {
        "camera": CRUSHER["camera"] | {"source": {"url": "rtsp://u:${CAM_PASSWORD}@10.0.0.5/x"}},  # type: ignore[operator]
        "more": {"bus": {**bus, "access": {"operators": ["room"], "gateways": ["other"]}}},
        "gateway": {
            "network": "10.30.0.0/16", "kind": "NodePort", "node_port": 30502, "broker": "10.0.0.9/32",
            "more": {"mqtt": {"broker": "10.0.0.9:8883", "tls": {"ca": "ca.crt"}}},
        },
    }  # fmt: skip
    place = tmp_path / "crushers.yaml"
    place.write_text(json.dumps(listed))
    write(place)
    access = read(tmp_path / "a/site.yaml")["bus"]["access"]
    assert access == {"operators": ["room"], "gateways": ["other", "gateway-a"]}
    assert "CAM_PASSWORD" not in (tmp_path / "a/gateway.yaml").read_text()
    patches = {
        (one["target"]["kind"], one["target"].get("name")): YAML(typ="safe", pure=True).load(one["patch"])
        for one in read(tmp_path / "a/kustomization.yaml")["patches"]
    }
    policy = patches["NetworkPolicy", "lumpwatch-gateway"]
    assert policy[1]["value"] == {
        "to": [{"ipBlock": {"cidr": "10.0.0.9/32"}}],
        "ports": [{"port": 8883, "protocol": "TCP"}],
    }
    assert patches["Service", "lumpwatch-gateway"][1]["value"] == 30502


def test_overlays_keep_the_cameras_apart(rendered: list[dict[str, Any]]) -> None:
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl is not installed")
    pods, secrets = {}, set()
    classes = {one["metadata"]["name"] for one in rendered if one["kind"] == "PriorityClass"}
    for one in rendered:
        if one["kind"] == "StatefulSet":
            template = one["spec"]["template"]
            pods[one["metadata"]["name"]] = template["metadata"]["labels"]
            assert one["spec"]["selector"]["matchLabels"] == template["metadata"]["labels"]
            volumes = {volume["name"]: volume for volume in template["spec"]["volumes"]}
            secrets |= {volumes[what]["secret"]["secretName"] for what in ("camera", "bus")}
            assert "optional" not in volumes["bus"]["secret"], "without its certificate it must not start"
            assert template["spec"]["priorityClassName"] in classes
            assert template["spec"]["containers"][0]["image"] == "registry.example/lumpwatch:0.1.0"
            maps = {o["metadata"]["name"] for o in rendered if o["kind"] == "ConfigMap"}
            assert volumes["config"]["configMap"]["name"] in maps
    assert secrets == {f"{what}-crusher-{n}" for what in ("camera", "bus") for n in (1, 2)}

    pods |= {
        one["metadata"]["name"]: one["spec"]["template"]["metadata"]["labels"]
        for one in rendered
        if one["kind"] == "Deployment"
    }

    def chosen(selector: dict[str, str]) -> list[str]:
        return [name for name, labels in pods.items() if selector.items() <= labels.items()]

    gateways = [one for one in rendered if "gateway" in one["metadata"]["name"]]
    for one in gateways:
        if one["kind"] in ("Service", "NetworkPolicy"):
            spec = one["spec"]
            selector = spec["selector"] if one["kind"] == "Service" else spec["podSelector"]["matchLabels"]
            assert chosen(selector) == [one["metadata"]["name"]]
    rendered = [one for one in rendered if one not in gateways]
    for one in rendered:
        spec = one.get("spec", {})
        if one["kind"] == "Service":
            assert chosen(spec["selector"]) == [one["metadata"]["name"].replace("-outside", "")]
            assert spec["publishNotReadyAddresses"] is True
        elif one["kind"] == "PodDisruptionBudget":
            assert chosen(spec["selector"]["matchLabels"]) == [one["metadata"]["name"]]
        elif one["kind"] == "NetworkPolicy":
            assert chosen(spec["podSelector"]["matchLabels"]) == [one["metadata"]["name"]]
            (client,) = spec["ingress"][0]["from"]
            assert list(client["podSelector"]) == ["matchExpressions"]
    (monitor,) = [one for one in rendered if one["kind"] == "ServiceMonitor"]
    (outside,) = [one for one in rendered if one["kind"] == "Service" and "type" in one["spec"]]
    assert outside["spec"]["ports"] == [{"name": "bus", "port": 7447, "targetPort": "bus"}]
    services = [one for one in rendered if one["kind"] == "Service" and one is not outside]
    wanted = monitor["spec"]["selector"]["matchLabels"]
    assert all(wanted.items() <= one["metadata"]["labels"].items() for one in services)
    assert {endpoint["port"] for endpoint in monitor["spec"]["endpoints"]} == {"metrics"}
    # What the rules and dashboards select by.
    (scrape,) = read(ROOT / "deploy/prometheus/prometheus.yml")["scrape_configs"]
    assert {one["metadata"]["labels"][monitor["spec"]["jobLabel"]] for one in services} == {
        scrape["job_name"]
    }
    (relabeling,) = monitor["spec"]["endpoints"][0]["relabelings"]
    assert relabeling["targetLabel"] == "site"
    assert {one["metadata"]["namespace"] for one in services} == {"north-pit"}


def test_the_example_is_what_its_list_says() -> None:
    place = KUBERNETES / "example/crushers.yaml"
    for file, content in files_of(read_site(place), place).items():
        assert (place.parent / file).read_text() == content


def test_a_site_is_written_from_its_list_and_follows_it(tmp_path: Path) -> None:
    place = tmp_path / "crushers.yaml"
    place.write_text(json.dumps(site_of("a", "b")))
    write(place)
    other = tmp_path / "kept" / "kustomization.yaml"
    other.parent.mkdir()
    other.write_text("# by hand")
    place.write_text(json.dumps(site_of("b")))
    write(place)
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_dir()) == ["b", "kept"]
    assert read(tmp_path / "kustomization.yaml")["resources"][0] == "b"
    config = parse_config((tmp_path / "b/site.yaml").read_text(), "b")
    assert config.bus.tls is not None
    assert config.bus.tls.certificate.name == "tls.crt"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"crushers": [CRUSHER, CRUSHER]}, "the camera a is there twice"),
        ({"crushers": []}, "crushers"),
        ({"nampespace": "x"}, "nampespace"),
        ({"image": "registry.example:5000/lumpwatch"}, "expected NAME:TAG"),
        ({"crushers": [{**CRUSHER, "network": "the yard"}]}, "crushers.0.network"),
        ({"crushers": [{**CRUSHER, "camera": {"id": "a"}}]}, "source"),
        ({"crushers": [{**CRUSHER, "outside": {"network": "10.0.0.0/8", "node_port": 80}}]}, "node_port"),
        ({"crushers": [{**CRUSHER, "gateway": {"network": "the PLC"}}]}, "gateway.network"),
        ({"crushers": [{**CRUSHER, "gateway": {"network": "10.0.0.7/32", "more": {"opcua": {}}}}]}, "opcua"),
        ({"crushers": [{**CRUSHER, "gateway": {"network": "10.0.0.7/32", "broker": "10.0.0.9/32"}}]}, "mqtt"),
        ({"crushers": [{**CRUSHER, "more": {"bus": {"listen": ["tcp/0.0.0.0:7447"]}}}]}, "bus"),
    ],
)
def test_a_list_that_is_wrong_is_refused_by_name(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    place = tmp_path / "crushers.yaml"
    place.write_text(json.dumps({**site_of("a"), **change}))
    with pytest.raises((ValueError, ConfigError), match=re.escape(said)):
        write(place)
    assert [p.name for p in tmp_path.iterdir()] == ["crushers.yaml"]


def test_the_operator_gets_the_same_rules() -> None:
    assert TARGET.read_text() == text()
    spec = read(TARGET)["spec"]
    files = sorted((ROOT / "deploy/prometheus/rules").glob("*.yml"))
    assert spec["groups"] == [group for file in files for group in read(file)["groups"]]


def test_what_the_image_is_made_of_is_written_down(tmp_path: Path) -> None:
    """`make sbom`: every locked package of the image is in it, with its version."""
    done = subprocess.run(["make", "sbom"], cwd=ROOT, capture_output=True, text=True, timeout=170)
    if done.returncode:
        pytest.skip(f"cyclonedx-bom cannot be run: {done.stderr.strip().splitlines()[-1]}")
    made = json.loads((ROOT / "build/sbom.json").read_text())
    assert made["bomFormat"] == "CycloneDX"
    lock = (ROOT / "deploy/container/requirements.lock").read_text()
    locked = dict(re.findall(r"^([\w.-]+)==([^\s;]+)", lock, re.MULTILINE))
    assert {one["name"]: one["version"] for one in made["components"]} == locked
    assert {"numba", "eclipse-zenoh", "pydantic"} <= set(locked)


def test_the_dockerfile_is_clean() -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent)) or shutil.which("hadolint")
    if hadolint is None:
        pytest.skip("hadolint is not installed")
    done = subprocess.run([hadolint, str(ROOT / "Dockerfile")], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout


def test_the_image_needs_no_shell_and_no_root() -> None:
    final = (ROOT / "Dockerfile").read_text().rpartition("\nFROM ")[2]
    assert f"USER {USER}:{USER}" in final
    for instruction in ("ENTRYPOINT", "CMD", "HEALTHCHECK"):
        (line,) = re.findall(rf"^{instruction} (?:.*\\\n\s*CMD )?(.*)$", final, re.MULTILINE)
        assert line.startswith("["), f"{instruction} by a shell: signals would not reach the daemon"
